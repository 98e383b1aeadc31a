"""Input that is refused, or repaired: its one line and its exit status are behaviour."""

from __future__ import annotations

import copy
import csv
import gzip
import io
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.behaviour.steps import Case, Code, Step, lines, shipped, youbot

Rows = list[list[str]]

PAPER: dict[str, Any] = {
    "schema_version": 1,
    "name": "handmade",
    "mechanism": "mecanum",
    "geometry": {"l": 0.15, "h": 0.2355, "R": 0.0475, "r": 0.014, "m1": 1.4},
    "parameters": {
        "m0": {"value": 35.3, "unit": "kg", "std": None},
        "I0": {"value": 4.4, "unit": "kg m^2", "std": None},
        "I1": {"value": 0.006, "unit": "kg m^2", "std": None},
        "aX": {"value": 0.016, "unit": "m", "std": None},
        "aY": {"value": -0.026, "unit": "m", "std": None},
        "mu1": {"value": 0.11, "unit": "N m s", "std": None},
        "mu2": {"value": 0.00578, "unit": "N m s", "std": None},
    },
    "effects": {},
    "covariance": None,
    "logs": [],
    "errors": {},
    "provenance": {},
}
"""A model file as README describes it."""

GAINS: dict[str, Any] = {
    "schema_version": 1,
    "controller": "kinematic",
    "gains": {
        "proportional": {"value": 0.2, "unit": "N m s/rad"},
        "integral": {"value": 3.0, "unit": "N m/rad"},
        "lead": {"value": 0.0, "unit": "s"},
    },
}

LENGTH = 1500
"""Rows of the logs that are damaged."""


# --- logs ------------------------------------------------------------------------------------


def column(rows: Rows, name: str) -> int:
    return rows[0].index(name)


def put(rows: Rows, name: str, lines: range, cell: str | Callable[[float], float]) -> None:
    """Write into a column at these rows, counted from 1 below the header."""
    k = column(rows, name)
    for line in lines:
        rows[line][k] = cell if isinstance(cell, str) else f"{cell(float(rows[line][k])):.4f}"


def drop(rows: Rows, name: str) -> None:
    k = column(rows, name)
    for row in rows:
        del row[k]


def exchange(rows: Rows, one: str, other: str) -> None:
    i, k = column(rows, one), column(rows, other)
    rows[0][i], rows[0][k] = rows[0][k], rows[0][i]


def repaired(rows: Rows) -> None:
    """An outlier, a gap of four cells, a missing row, a row that is there twice."""
    put(rows, "velocity_fr", range(300, 301), "95.0")
    put(rows, "effort_bl", range(500, 504), "nan")
    rows.insert(901, list(rows[900]))
    del rows[700]


ALL = range(1, LENGTH + 1)

DAMAGES: dict[str, Callable[[Rows], object]] = {
    "repaired": repaired,
    "healthy": lambda rows: None,
    "time_falls": lambda rows: put(rows, "time", ALL, lambda t: -t),
    "time_stands": lambda rows: put(rows, "time", ALL, "1.0"),
    "time_jumps_back": lambda rows: put(rows, "time", range(800, 1501), lambda t: t - 9.0),
    "time_in_ms": lambda rows: put(rows, "time", ALL, lambda t: 1000 * t),
    "missing_column": lambda rows: drop(rows, "effort_br"),
    "no_time": lambda rows: drop(rows, "time"),
    "column_twice": lambda rows: rows[0].__setitem__(2, "velocity_fl"),
    "nan_column": lambda rows: put(rows, "effort_fl", ALL, "nan"),
    "nan_for_long": lambda rows: put(rows, "velocity_bl", range(400, 700), "nan"),
    "text_cell": lambda rows: put(rows, "effort_fl", range(77, 78), "much"),
    "short_row": lambda rows: rows[40].pop(),
    "huge_value": lambda rows: put(rows, "effort_fl", range(10, 200), "1e9"),
    "rows_lost": lambda rows: rows.__delitem__(slice(400, 700)),
    "speeds_in_rpm": lambda rows: [
        put(rows, name, ALL, lambda w: w * 30 / math.pi) for name in rows[0] if "velocity" in name
    ],
    "left_negated": lambda rows: [
        put(rows, f"{kind}_{wheel}", ALL, lambda x: -x)
        for kind in ("velocity", "effort")
        for wheel in ("fl", "bl")
    ],
    "wheels_exchanged": lambda rows: exchange(rows, "velocity_fl", "velocity_br"),
    "one_wheel_stands": lambda rows: put(rows, "velocity_bl", ALL, "0"),
    "standstill": lambda rows: [
        put(rows, name, ALL, "0") for name in rows[0] if name.startswith(("velo", "effort"))
    ],
    "one_row": lambda rows: rows.__delitem__(slice(2, None)),
    "header_only": lambda rows: rows.__delitem__(slice(1, None)),
    "one_second": lambda rows: rows.__delitem__(slice(51, None)),
}

RAW = {
    "empty.csv": b"",
    "binary.csv": bytes(range(256)) * 20,
    "latin.csv": "time;velocit\u00e9\n1;2\n".encode("latin-1"),
    "not_zipped.csv.gz": b"time,velocity_fl\n0,0\n",
    "log.xlsx": b"time\n",
    "log.bag": b"#ROSBAG V2.0\n",
}


def damaged_logs(folder: Path, code: Code) -> None:
    shipped(folder, code)
    source = folder / "shipped" / "multisine_a.csv.gz"
    if not source.exists():
        return
    rows = list(csv.reader(io.StringIO(gzip.decompress(source.read_bytes()).decode())))
    for name, damage in DAMAGES.items():
        changed = copy.deepcopy(rows[: LENGTH + 1])
        damage(changed)
        text = "".join(",".join(row) + "\n" for row in changed)
        (folder / f"{name}.csv").write_text(text)
    for name, content in RAW.items():
        (folder / name).write_bytes(content)
    (folder / "folder.csv").mkdir()


# --- models, gains, geometries, effects, motions ---------------------------------------------


def changed(base: dict[str, Any], path: str, value: Any) -> str:
    """A file with one entry changed, or without it if `value` is `...`."""
    content = copy.deepcopy(base)
    *parents, last = path.split(".")
    place = content
    for parent in parents:
        place = place[parent]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return json.dumps(content)


def bad_models() -> dict[str, str]:
    covariance = {"names": ["m0", "I0"], "matrix": [[1.0, 2.0], [2.0, 1.0]]}
    tilt = {"tilt_x": {"value": 0.1, "unit": "rad", "std": None}}
    return {
        "good": json.dumps(PAPER),
        "unknown_key": changed(PAPER, "colour", "red"),
        "missing_key": changed(PAPER, "parameters", ...),
        "duplicate_key": json.dumps(PAPER).replace('"mu1": {', '"m0": {', 1),
        "duplicate_top_key": json.dumps(PAPER).replace('"errors"', '"name"', 1),
        "version_9": changed(PAPER, "schema_version", 9),
        "other_mechanism": changed(PAPER, "mechanism", "car"),
        "missing_parameter": changed(PAPER, "parameters.mu2", ...),
        "unknown_parameter": changed(PAPER, "parameters.m9", {"value": 1, "unit": "kg"}),
        "negative_mass": changed(PAPER, "parameters.m0.value", -35.3),
        "light": changed(PAPER, "parameters.m0.value", 3.0),
        "nan_value": changed(PAPER, "parameters.I0.value", float("nan")),
        "text_value": changed(PAPER, "parameters.I0.value", "heavy"),
        "bool_value": changed(PAPER, "parameters.I0.value", True),
        "wrong_unit": changed(PAPER, "parameters.m0.unit", "lb"),
        "negative_std": changed(PAPER, "parameters.m0.std", -1.0),
        "unknown_effect": changed(PAPER, "effects.wind", {"parameters": {}}),
        "effect_lacks": changed(PAPER, "effects.floor_tilt", {"parameters": tilt}),
        "radius_0": changed(PAPER, "geometry.R", 0.0),
        "no_covariance": changed(PAPER, "covariance", covariance),
        "list": "[1, 2]",
        "not_json": "m0 = 35.3",
        "torn": json.dumps(PAPER)[:200],
        "empty": "",
    }


FILES = {
    "gains_unknown.json": changed(GAINS, "gains.speed", {"value": 1.0, "unit": "1"}),
    "gains_missing.json": changed(GAINS, "gains.integral", ...),
    "gains_negative.json": changed(GAINS, "gains.proportional.value", -1.0),
    "gains_controller.json": changed(GAINS, "controller", "magic"),
    "gains_twice.json": json.dumps(GAINS).replace('"lead"', '"integral"', 1),
    "geometry_short.json": json.dumps({"l": 0.15, "h": 0.2355}),
    "geometry_negative.json": json.dumps({**PAPER["geometry"], "R": -0.05}),
    "geometry_good.json": json.dumps({**PAPER["geometry"], "R": 0.05}),
    "motion_kind.json": json.dumps({"kind": "dance", "name": "x", "duration": 3.0}),
    "motion_key.json": json.dumps({"kind": "circling", "name": "x", "duration": 3.0}),
    "motion_long.json": json.dumps(
        {"kind": "circling", "name": "x", "duration": 1e9, "frequency": 1.0, "speed": 0.2}
    ),
    "effects_syntax.py": "def x(:\n    pass\n",
    "effects_none.py": "x = 1\n",
    "effects_raise.py": "import nothing_of_this_name\n",
    "policy.json": json.dumps({"schema_version": 1, "name": "mine"}),
}


def bad_files(folder: Path, code: Code) -> None:
    damaged_logs(folder, code)
    for name, text in bad_models().items():
        (folder / f"model_{name}.json").write_text(text)
    for name, text in FILES.items():
        (folder / name).write_text(text)


# --- the cases -------------------------------------------------------------------------------


def of_logs() -> Case:
    """Every damaged log: doctor says what is wrong with all of them, identify refuses each."""
    names = [*(f"{name}.csv" for name in DAMAGES), *RAW, "folder.csv", "absent.csv"]
    steps = (
        youbot(f"doctor {' '.join(names)} --json doctor.json", "doctor all"),
        youbot("identify repaired.csv -o model.json --json identify.json", "identify repaired"),
        youbot("identify missing_column.csv"),
        lines("doctor one by one", [f"doctor {name}" for name in names[::4]]),
        lines("identify", [f"identify {name}" for name in names]),
    )
    return Case("bad_logs", steps, True, prepare=damaged_logs)


def of_models() -> Case:
    steps = (
        youbot("compare model_unknown_effect.json healthy.csv", "compare"),
        lines("compare each", [f"compare model_{name}.json healthy.csv" for name in bad_models()]),
    )
    return Case("bad_models", steps, True, prepare=bad_files)


BAD_LINES = """
identify healthy.csv --geometry geometry_short.json
identify healthy.csv --geometry geometry_negative.json
identify healthy.csv --geometry geometry_good.json
identify healthy.csv --geometry absent.json
identify healthy.csv --mechanism car
identify healthy.csv --mechanism axis
identify healthy.csv --colour red
identify healthy.csv --seed -1
identify healthy.csv --seed much
identify healthy.csv -o absent/model.json
identify healthy.csv -o folder.csv
identify healthy.csv healthy.csv
identify
compare paper
compare absent.json healthy.csv
compare paper absent.csv
diagnose paper healthy.csv --effects effects_syntax.py
diagnose paper healthy.csv --effects effects_none.py
diagnose paper healthy.csv --effects effects_raise.py
diagnose paper healthy.csv --effects absent.py
diagnose paper healthy.csv --mechanism axis
add paper floor_tlit healthy.csv
add paper floor_tilt
effects floor_tlit
effects --mechanism car
record out --effect floor_tlit
record out --effect floor_tilt:tilt=0.1
record out --effect floor_tilt:tilt_x=much
record out --effect floor_tilt:tilt_x=9
record out --rate 5
record out --motions V
record out --motions I,I
record out --motions motion_kind.json
record out --motions motion_key.json
record out --motions motion_long.json
record out --plant absent.json
record out --plant contact:colour=red
record out --plant contact:friction=-1
record out --format xml
record out --torque-noise -1
record healthy.csv
evaluate --suite nothing
evaluate --controllers nothing
evaluate --model known --jobs 1 --controllers gains_unknown.json
evaluate --model known --jobs 1 --controllers gains_missing.json
evaluate --model known --jobs 1 --controllers gains_negative.json
evaluate --model known --jobs 1 --controllers gains_controller.json
evaluate --model known --jobs 1 --controllers gains_twice.json
evaluate --model known --jobs 1 --controllers policy.json
evaluate --bands 3-1
evaluate --bands fast
evaluate --seeds 0
evaluate --model absent.json
evaluate --model nothing
evaluate --against nothing
tune paper --lead --controller pid
tune paper --delay -1
tune paper --gain-margin 90
tune absent.json
train dqn
train ppo --set colour=red
train ppo --set gamma
train ppo --randomise m9=1:2
train ppo --residual nothing
train ppo --resume
bench --kinds nothing
bench --rates 5
dance
--colour
"""


def of_options() -> Case:
    given = [line for line in BAD_LINES.splitlines() if line]
    return Case("bad_options", (lines("each", given),), True, prepare=bad_files)


def cases() -> tuple[Case, ...]:
    nothing = Case("no_words", (Step((), name="no words"),), True)
    return (of_logs(), of_models(), of_options(), nothing)
