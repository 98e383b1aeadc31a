"""Writing a blind set: see `published`."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from identification.comparison import compare
from identification.fitting.identify import identify
from identification.logs.log import Log
from identification.logs.reading import read_logs, write_log
from youbot_env.errors import InputError
from youbot_env.files import SCHEMA_VERSION, write_atomically, write_json
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.blind_bench.cases import UNSEEN, logs_of, unseen_log
from youbot_scripts.blind_bench.effects import EVERYTHING
from youbot_scripts.blind_bench.published import ANSWERS, CASES, INDEX, LOGS
from youbot_scripts.blind_bench.trials import Spec
from youbot_scripts.shared.workers import spread

RULES = """# A blind set

`cases/CODE/` holds three logs of one simulated mecanum platform each, `calibration.csv`,
`multisine_a.csv` and `multisine_b.csv` (columns and units: "Log files" of the youbot package's
documentation), and `unseen.csv`, the motion of a fourth run without its torques. Something may be
missing from the seven-parameter model of each platform, or nothing. Say what, in one JSON file:

    {"schema_version": 1, "tool": "NAME",
     "cases": {"CODE": {"verdict": "adequate" | "effect" | "ambiguous" | "unknown",
                        "effects": [["floor_tilt"], ["actuator_lag", "torque_delay"]],
                        "law": {"site": "world", "variables": ["heading"]} | null,
                        "predictions": "CODE.csv" | null}}}

`effects`: of each that is missing its name in the catalogue (`youbot effects`), or a set of at most
three that the logs cannot tell apart, its best member first. `law`: for what has no name there,
where it acts (body, world, wheel, roller, channel) and the variables that it depends on.
`predictions`: a file beside the JSON with the columns time, effort_fl, effort_fr, effort_bl,
effort_br: the torques that drove the fourth run.

Score it by `youbot bench --publish FOLDER --score YOUR.json`. No tool may read `answers/`, and none
may be tuned on a set that it is then scored on: publish another one, with a seed of your own.
"""


def code_of(spec: Spec) -> str:
    """A case's name in a published set, which tells nothing of it."""
    text = f"{spec.kind} {spec.index} {spec.seed} {spec.rate} {spec.noise}"
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def publish(
    specs: Sequence[Spec],
    folder: Path,
    *,
    jobs: int = 1,
    progress: Callable[[], None] = lambda: None,
) -> None:
    """Write a blind set; one that was interrupted is gone on with.

    Raises
    ------
    InputError
        If the folder holds a whole set, or anything but the beginning of this one.
    """
    _refuse_other_contents(folder, set(map(code_of, specs)))
    left = [spec for spec in specs if not _answer_of(folder, code_of(spec)).is_file()]
    for _ in range(len(specs) - len(left)):
        progress()
    for _ in spread(partial(_write_case, folder), left, jobs):
        progress()
    write_json(folder / INDEX, {"schema_version": SCHEMA_VERSION,
                                "cases": sorted(map(code_of, specs))})  # fmt: skip
    write_atomically(folder / "README.md", RULES)


def _refuse_other_contents(folder: Path, codes: set[str]) -> None:
    found = {path.name for path in folder.iterdir()} if folder.exists() else set()
    cases = {path.name for path in (folder / CASES).glob("*")}
    if not found <= {CASES, ANSWERS} or not cases <= codes:
        raise InputError(f"{folder}: is not empty; a blind set needs a folder of its own")


def _answer_of(folder: Path, code: str) -> Path:
    """A case's answer, which is written last."""
    return folder / ANSWERS / f"{code}.json"


def _write_case(folder: Path, spec: Spec) -> str:
    """Write one case and its answer; returns its code."""
    case, code = spec.draw(), code_of(spec)
    place = folder / CASES / code
    place.mkdir(parents=True, exist_ok=True)
    (folder / ANSWERS).mkdir(exist_ok=True)
    for log in logs_of(case):
        write_log(place / f"{log.name}.csv", log, decimals=9)
    unseen = unseen_log(case)
    write_log(folder / ANSWERS / f"{code}.csv", unseen, decimals=9)
    _write_motion(place / f"{UNSEEN}.csv", unseen)
    base = identify(read_logs([place / f"{name}.csv" for name in LOGS]), recursive=False).model
    found = compare(base, [unseen]).to_dict()
    answer = {
        "case": case.to_dict(),
        "carriers": sorted({c for item in case.planted for c in EVERYTHING[item.name].carriers}),
        "base_error": found["total"]["force_error"],
        "noise_floor": found["noise_floor"]["force_error"],
    }
    write_json(_answer_of(folder, code), {"schema_version": SCHEMA_VERSION, **answer})
    return code


def _write_motion(path: Path, log: Log) -> None:
    names = ["time", *(f"velocity_{wheel}" for wheel in WHEELS)]
    columns = [log.time, *log.velocity.T]
    if log.pose is not None:
        names += ["pose_x", "pose_y", "pose_yaw"]
        columns += list(log.pose.T)
    rows = ([f"{value:.9g}" for value in row] for row in np.column_stack(columns))
    write_atomically(path, "\n".join([",".join(names), *map(",".join, rows)]) + "\n")
