"""One robot: screened, diagnosed where the screen does not pass it, and its result kept.

A worker gets paths and numbers alone, and writes the robot's files itself: what is finished stays,
whatever happens to the process that started it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from identification.diagnosis.diagnose import Diagnosis, diagnose
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import Ranking
from identification.fitting.identify import Identification, identify
from identification.logs.log import Log, warnings_of_logs
from identification.logs.reading import SetAside, read_usable_logs
from identification.mechanisms.registry import (
    AnyModel,
    kind_of,
    load_any_model,
    platform_geometry,
    save_any_model,
)
from youbot_env.errors import InputError
from youbot_env.physics.effect import effect_of
from youbot_scripts.fleets.records import DIAGNOSIS, SCREEN, Record, RobotFiles
from youbot_scripts.fleets.robots import Task
from youbot_scripts.fleets.settings import FleetSettings
from youbot_scripts.shared.results_folder import failure


def diagnose_robot(task: Task) -> str:
    """Diagnose a robot, write its result and its model, and return its name.

    Whatever goes wrong with one robot becomes its result, so that it does not stop the others.
    """
    files = RobotFiles(task.folder, task.robot.name)
    began = time.perf_counter(), time.process_time()
    record: Record = {"robot": task.robot.name, "fingerprint": task.fingerprint}
    try:
        found, model = _diagnosed(task)
        record |= found
        save_any_model(files.model, model)
    except InputError as error:
        # Of the log its name alone, as on every machine.
        folder = f"{task.robot.logs[0].parent}/" if task.robot.logs else ""
        record |= {"error": str(error).removeprefix(folder)}
    except Exception as error:
        record |= failure(error)
    cost = {"wall": time.perf_counter() - began[0], "cpu": time.process_time() - began[1]}
    if "error" in record:
        files.model.unlink(missing_ok=True)  # one of earlier logs
    # The result last: where it is, the model is.
    files.write(record, cost)
    return task.robot.name


def _diagnosed(task: Task) -> tuple[Record, AnyModel]:
    if not task.robot.logs:
        raise InputError("no logs: the folder holds no .csv, .csv.gz or .parquet file")
    start = load_any_model(task.model)
    kind = kind_of(start)
    logs, aside = read_usable_logs(task.robot.logs, kind.joints, geometry=platform_geometry(start))
    screened = identify(logs, start=start, recursive=False, seed=task.seed)
    doubts = doubts_of(screened, logs, task.settings)
    record: Record = {
        "logs": [{"name": log.name, "sha256": log.sha256} for log in logs],
        "set_aside": [_without_folder(item) for item in aside],
        "screen": {"passed": not doubts, "doubts": doubts},
    }
    if not doubts and not task.in_full:
        return record | _of_screen(screened), screened.model
    draws = task.settings.bootstrap_draws
    chosen = replace(DiagnosisSettings(), bootstrap_draws=draws)
    found = diagnose(start, logs, seed=task.seed, settings=chosen)
    return record | _of_diagnosis(found), found.model


def doubts_of(screened: Identification, logs: Sequence[Log], settings: FleetSettings) -> list[str]:
    """Why a fit of the model as it is does not show that nothing is missing; [] where it does."""
    share = screened.predictable.share
    of_logs = set(warnings_of_logs(logs))
    doubts = [line for line in screened.first_warnings if line not in of_logs]
    doubts += [
        f"{screened.mechanism.parameter_names[screened.fit.free[k]]} at its physical bound"
        for k in screened.fit.bounded
    ]
    if share > settings.max_screened_share and screened.misfit is None:
        doubts.append(f"the motion predicts {share:.1%} of the residual's squares")
    uneven = screened.predictable.mean_over_median
    if uneven > settings.max_screened_mean_over_median:
        doubts.append(f"the residual is uneven in time: its mean square is {uneven:.2g} medians")
    return doubts


def _of_screen(screened: Identification) -> Record:
    errors = screened.model.errors
    return {
        "by": SCREEN,
        "verdict": "adequate",
        "missing": [],
        "ambiguous_with": {},
        "headline": screened.summary(),
        "p_values": {},
        "force_error": errors["force_error"],
        "noise_floor": errors["noise_floor"]["force_error"],
        "parameters": _parameters(screened.model),
        "warnings": list(screened.warnings),
    }


def _of_diagnosis(found: Diagnosis) -> Record:
    p_values = accepted_p_values(found.rankings)
    return {
        "by": DIAGNOSIS,
        "verdict": found.verdict,
        "missing": list(found.missing),
        "ambiguous_with": found.ambiguous_with,
        "headline": found.summary(),
        "p_values": {name: p_values.get(name) for name in found.missing},
        "force_error": found.steps[-1].force_error,
        "noise_floor": found.noise_floor["force_error"],
        "parameters": _parameters(found.model),
        "warnings": list(found.warnings),
    }


def accepted_p_values(rankings: Sequence[Ranking]) -> dict[str, float]:
    """By effect, the p-value with which it won its ranking; of several rankings the first."""
    # In a ranking an effect stands once more where it was tried in some logs only.
    return {
        effect_of(ranking.best.name): ranking.p_values[ranking.best.name]
        for ranking in reversed(rankings)
        if ranking.best is not None
    }


def _parameters(model: Any) -> dict[str, dict[str, Any]]:
    """Value, unit and standard deviation of all parameters, effects' as EFFECT.PARAMETER."""
    estimates = dict(model.parameters) | {
        f"{effect}.{name}": estimate
        for effect, values in model.effects.items()
        for name, estimate in values.items()
    }
    return {
        name: {"value": item.value, "unit": item.unit, "std": item.std}
        for name, item in estimates.items()
    }


def _without_folder(item: SetAside) -> dict[str, str]:
    # The same on every machine, wherever its folders are.
    return {"log": Path(item.log).name, "reason": item.reason}
