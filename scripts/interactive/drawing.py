"""What the workbench's charts show, computed in a process of its own and kept as plain arrays.

``python -m youbot_scripts.interactive.drawing FOLDER KIND NUMBER MODEL BEFORE EFFECTS LOG...``
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.files import write_atomically
from youbot_scripts.shared.options import load_user_effects

if TYPE_CHECKING:
    from identification.logs.log import Log
    from identification.mechanisms.quantities import Quantities
    from identification.mechanisms.registry import AnyModel
    from identification.residual_map.shares import ResidualMap

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
    from identification.figures.single_charts import residual_charts
    from identification.logs.reading import read_log
    from identification.mechanisms.registry import load_any_model, quantities_of

    names = [before, model] if before else [model]
    models = [load_any_model(name) for name in names]
    read = [read_log(path, joints=models[0].mechanism.joints) for path in logs]
    shown = quantities_of(models[0])
    # One after another: the signals of an hour at 1 kHz are there once.
    found = [_draw_one(out, j, item, read, shown) for j, item in enumerate(models)]
    maps = [(name, where) for name, (where, _) in zip(_short(names), found, strict=True)]
    charts = list(residual_charts(maps, shown.forces))
    return {
        "kind": "model",
        "models": _short(names),
        "logs": [log.name for log in read],
        "forces": [list(pair) for pair in shown.forces],
        "speeds": [list(pair) for pair in shown.speeds],
        "residual": [json.loads(chart.figure.to_json() or "{}") for chart in charts],
        "heights": [chart.height for chart in charts],
        "errors": [numbers["total"] for _, numbers in found],
        "noise_floor": found[-1][1]["noise_floor"],
    }


def _draw_one(
    out: Path, number: int, model: AnyModel, logs: Sequence[Log], shown: Quantities
) -> tuple[ResidualMap, dict[str, Any]]:
    """Save the signals of one model; its residual map and its numbers."""
    from identification.comparison import compare
    from identification.figures.charts import pose_of

    result = compare(model, logs)
    for k, item in enumerate(result.logs):
        for name in ("velocity", "force"):
            scale = shown.speed_scale if name == "velocity" else np.ones(len(shown.forces))
            traces = getattr(item, name)
            if number == 0:
                save(out / f"{name}_{k}_time.npy", traces.time)
                save(out / f"{name}_{k}_measured.npy", traces.measured * scale)
            save(out / f"{name}_{k}_predicted_{number}.npy", traces.predicted * scale)
        if number == 0 and len(shown.speeds) == 3:
            save(out / f"pose_{k}.npy", pose_of(item, shown))
    return result.where, result.to_dict()


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
