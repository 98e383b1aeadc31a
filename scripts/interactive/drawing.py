"""What the workbench's charts show, computed in a process of its own and kept as plain arrays.

``python -m youbot_scripts.interactive.drawing FOLDER KIND NUMBER MODEL BEFORE EFFECTS LOG...``
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_scripts.shared.options import load_user_effects

Array = NDArray[np.float64]


def main(arguments: Sequence[str]) -> None:
    """Draw one step."""
    folder, kind, number, model, before, effects, *rest = arguments
    load_user_effects(Path(effects) if effects else None)
    out = Path(folder) / number
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    made = draw_drive(out, rest) if kind == "drive" else draw_model(out, model, before, rest)
    # Last: charts are there when this file is.
    write_atomically(out / "charts.json", json.dumps(made))


def draw_model(out: Path, model: str, before: str, logs: Sequence[str]) -> dict[str, Any]:
    """Signals, floor plan and residual of a model on logs, beside those of the model before it."""
    from identification.comparison import compare
    from identification.figures.charts import pose_of
    from identification.figures.single_charts import residual_charts
    from identification.logs.reading import read_log
    from identification.mechanisms.registry import load_any_model, quantities_of

    names = [before, model] if before else [model]
    models = [load_any_model(name) for name in names]
    read = [read_log(path, joints=models[0].mechanism.joints) for path in logs]
    found = [compare(item, read) for item in models]
    shown = quantities_of(models[0])
    for k, item in enumerate(found[0].logs):
        of_each = [result.logs[k] for result in found]
        for name in ("velocity", "force"):
            scale = shown.speed_scale if name == "velocity" else np.ones(len(shown.forces))
            traces = [getattr(one, name) for one in of_each]
            save(out / f"{name}_{k}_time.npy", traces[0].time)
            save(out / f"{name}_{k}_measured.npy", traces[0].measured * scale)
            for j, trace in enumerate(traces):
                save(out / f"{name}_{k}_predicted_{j}.npy", trace.predicted * scale)
        if len(shown.speeds) == 3:
            save(out / f"pose_{k}.npy", pose_of(item, shown))
    maps = [(name, result.where) for name, result in zip(_short(names), found, strict=True)]
    charts = list(residual_charts(maps, shown.forces))
    return {
        "kind": "model",
        "models": _short(names),
        "logs": [item.log.name for item in found[0].logs],
        "forces": [list(pair) for pair in shown.forces],
        "speeds": [list(pair) for pair in shown.speeds],
        "residual": [json.loads(chart.figure.to_json() or "{}") for chart in charts],
        "heights": [chart.height for chart in charts],
        "errors": [result.to_dict()["total"] for result in found],
        "noise_floor": found[-1].to_dict()["noise_floor"],
    }


def draw_drive(out: Path, arguments: Sequence[str]) -> dict[str, Any]:
    """Reference and response of each controller of an `evaluate` command, in its middle band."""
    from youbot_scripts.evaluation.evaluation import evaluate
    from youbot_scripts.evaluation.suites import settings_from_options

    given = dict(zip(arguments[1::2], arguments[2::2], strict=False))
    options: dict[str, Any] = dict.fromkeys(_OPTIONS)
    options |= {
        "plants": [given["--plant"]], "models": given["--model"],
        "controllers": given["--controllers"], "bands": given["--bands"],
        "seeds": int(given["--seeds"]),
    }  # fmt: skip
    found = evaluate(settings_from_options("paper", options), jobs=1)
    names = []
    for trial in found.trials:
        trace = trial.trace()
        k = len(names)
        names.append(trial.controller)
        save(out / f"drive_{k}_time.npy", trace.time)
        save(out / f"drive_{k}_twist.npy", trace.twist)
        save(out / f"drive_{k}_reference.npy", trace.reference)
    return {"kind": "drive", "controllers": names}


_OPTIONS = (
    *("plants", "effects", "surprises", "models", "controllers", "bands", "seeds", "amplitude"),
    *("duration", "rate", "delay", "lag", "noise", "pose", "against"),
)
"""Of `evaluate`; what is not said there is the suite's."""


def save(path: Path, values: Array) -> None:
    """Keep an array in single precision, so that parts of it can be read from the disk."""
    np.save(path, np.asarray(values, np.float32), allow_pickle=False)


def _short(names: Sequence[str]) -> list[str]:
    return [Path(name).stem for name in names]


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(f"youbot: error: {error}")
