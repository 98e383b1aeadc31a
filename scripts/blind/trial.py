"""One blind trial: make a case, have it diagnosed, and note all that scoring needs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from identification.errors import Squares, add_up, velocity_traces
from identification.log import Log
from identification.mecanum import Mecanum
from youbot_env.effects import CATALOGUE as REGISTERED
from youbot_env.errors import InputError
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.motions import motion_from_dict
from youbot_scripts.blind.cases import Case, log_along, logs_of, tick
from youbot_scripts.blind.effects import EVERYTHING

Record = dict[str, Any]
"""What is kept of a trial, JSON-able: ``case``, ``found`` (the diagnosis's own JSON),
``carriers``, ``sizes``, ``true_velocity_error``, ``seconds``; ``after``, the diagnosis with the
proposed experiment; ``error`` where it failed."""


Diagnose = Callable[..., Any]
"""diagnose(model, logs, seed=...), whose result has ``to_dict`` as the design fixes it."""


def true_model(case: Case) -> Model | None:
    """The model that knows everything; None where a planted effect is not in the catalogue."""
    model = load_model("paper").with_values(case.platform)
    for item in case.planted:
        if item.name not in REGISTERED:
            return None
        model = model.with_effect(item.name, **item.values)
    return model


def velocity_error(model: Model, logs: Sequence[Log]) -> float:
    """Velocity error of a model's free run over all logs."""
    mechanism = Mecanum(model.geometry, model.structure)
    runs = (velocity_traces(mechanism, model.theta, mechanism.samples(log)) for log in logs)
    return add_up(map(Squares.of, runs)).ratio


def stated_sizes(found: Any, report: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Value and std of the accepted effects' parameters, by ``effect.parameter``."""
    model = getattr(found, "fitted_model", None)  # none where the base is not physical
    if isinstance(model, Model):
        effects = {
            name: {key: (estimate.value, estimate.std) for key, estimate in values.items()}
            for name, values in model.effects.items()
        }
    else:
        effects = {
            row["effect"]: {
                key: (value.get("value"), value.get("std"))
                for key, value in (row.get("parameters") or {}).items()
                if isinstance(value, dict)
            }
            for row in report.get("candidates", [])
            if row["effect"] in report["missing"]
        }
    return {
        f"{name}.{key}": {"value": float(value), "std": float(std)}
        for name, values in effects.items()
        for key, (value, std) in values.items()
        if value is not None and std is not None
    }


def experiment(case: Case, proposed: Mapping[str, Any]) -> Log:
    """The log of a proposed motion on the case's own platform."""
    motion = motion_from_dict(proposed["motion"])
    dt, _ = tick(case.rate)
    twist = motion.twist(dt * np.arange(round(motion.duration / dt) + 1))
    return log_along(case, "next_experiment", twist)


def run_trial(case: Case, diagnose: Diagnose, follow_up: bool = False) -> Record:
    """Make a case's logs and have them diagnosed, starting from the published model.

    With ``follow_up`` what is tied is diagnosed again with the proposed experiment's log beside.
    """
    logs = logs_of(case)
    record: Record = {
        "case": case.to_dict(),
        "carriers": sorted({c for item in case.planted for c in EVERYTHING[item.name].carriers}),
    }
    before = time.perf_counter()
    try:
        found = diagnose(load_model("paper"), logs, seed=case.seed)
    except InputError as error:
        return record | {"seconds": time.perf_counter() - before, "error": str(error)}
    record["seconds"] = time.perf_counter() - before
    record["found"] = found.to_dict()
    record["sizes"] = stated_sizes(found, record["found"])
    truth = true_model(case)
    record["true_velocity_error"] = None if truth is None else velocity_error(truth, logs)
    proposed = record["found"].get("next_experiment")
    if follow_up and proposed and record["found"]["ambiguous_with"]:
        more = [*logs, experiment(case, proposed)]
        record["after"] = diagnose(load_model("paper"), more, seed=case.seed).to_dict()
    return record
