"""From logs to a model with honest uncertainty: the whole identification in one function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.errors import (
    NoiseLevel,
    Squares,
    add_up,
    force_floor,
    force_traces,
    velocity_traces,
)
from identification.fitting.least_squares import Fit, fit
from identification.fitting.observability import (
    Observability,
    block_estimates,
    log_observability,
    refuse_blind,
)
from identification.fitting.recursive import EstimateHistory, recursive_course
from identification.fitting.regression_rows import Rows, regression_rows
from identification.fitting.settings import FitSettings
from identification.logs.log import Log
from identification.mechanisms.calibration_parts import Part
from identification.mechanisms.mechanism import Mechanism, Samples
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import Geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PartReport:
    """What one stretch of one log shows.

    estimates: theta's parameters by name as (value, std), each from its block's columns and this
    stretch alone, for the blocks that the stretch shows whole.
    """

    log: str
    kind: str
    start: float
    end: float
    observability: Observability
    estimates: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Identification:
    """Result of :func:`identify`.

    Attributes
    ----------
    model : the fitted model (Model or AxisModel), with covariance, logs and errors
    fit : theta, covariance and residual rows behind it
    force : fit on forces; the same as ``fit`` without an output-error step
    parts : what each stretch of the logs shows; ``total``: all of them together
    course : the recursive estimator's estimates over time, or None
    settings : all numbers that the fit depends on
    warnings : plain sentences, the most serious first
    """

    model: Any
    fit: Fit
    force: Fit
    mechanism: Mechanism
    samples: tuple[Any, ...]
    parts: tuple[PartReport, ...]
    total: Observability
    course: EstimateHistory | None = None
    warnings: tuple[str, ...] = field(default_factory=tuple)
    settings: FitSettings = field(default_factory=FitSettings)

    def to_dict(self) -> dict[str, Any]:
        """JSON form: parameters with 95 % intervals, observability, errors, warnings."""
        values = self.model.values
        std = dict(
            zip(
                self.model.covariance_names,
                np.sqrt(np.maximum(np.diag(self.model.covariance), 0.0)),  # type: ignore[arg-type]
                strict=True,
            )
        )
        reach = self.settings.interval_deviations
        units = {name: estimate.unit for name, estimate in _estimates(self.model).items()}
        return {
            "parameters": {
                name: {
                    "value": values[name],
                    "unit": units[name],
                    "std": std.get(name),
                    "interval": None
                    if name not in std
                    else [values[name] - reach * std[name], values[name] + reach * std[name]],
                }
                for name in values
            },
            "errors": dict(self.model.errors),
            "observability": {
                "total": _observability_dict(self.total),
                "parts": [
                    {
                        "log": part.log,
                        "kind": part.kind,
                        "from": part.start,
                        "to": part.end,
                        **_observability_dict(part.observability),
                        "block_estimates": {
                            name: {"value": value, "std": std}
                            for name, (value, std) in part.estimates.items()
                        },
                    }
                    for part in self.parts
                ],
            },
            "recursive": None
            if self.course is None
            else dict(
                zip(
                    [self.mechanism.parameter_names[k] for k in self.force.free],
                    self.course.theta[-1].tolist(),
                    strict=True,
                )
            ),
            "logs": [dict(log) for log in self.model.logs],
            "settings": self.settings.to_dict(),
            "warnings": list(self.warnings),
        }


def _estimates(model: Any) -> dict[str, Any]:
    return dict(model.parameters) | {
        f"{effect}.{name}": estimate
        for effect, parameters in model.effects.items()
        for name, estimate in parameters.items()
    }


def _observability_dict(found: Observability) -> dict[str, Any]:
    return {
        "names": list(found.names),
        "rank": found.rank,
        "blind": found.describe_blind(),
        "blocks": [list(block) for block in found.blocks],
    }


def identify(
    logs: Sequence[Log],
    *,
    geometry: Geometry | None = None,
    start: AnyModel | None = None,
    output_error: bool = False,
    robust: bool = False,
    recursive: bool = True,
    settings: FitSettings = FitSettings(),
    seed: int = 0,
    name: str = "model",
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Identification:
    """Fit a model to logs of the mechanism that ``start`` is a model of.

    Parameters
    ----------
    logs : read by :func:`identification.logs.reading.read_log`
    geometry : the platform's; that of ``start`` or the youBot's by default
    start : model whose structure (effects) is fitted; the platform's base model by default
    output_error : refine in free run after the force fit
    robust : Huber weights, for logs with outliers
    recursive : also run the recursive estimator, for the estimates' course over time
    settings : all numbers that the fit depends on
    seed : of the noise floor's random numbers

    Raises
    ------
    InputError
        If the logs cannot show the model at all: with the motion that would show it.
    """
    if not logs:
        raise InputError("no log given: identify needs at least one")
    start = start or load_model("paper")
    mechanism = mechanism_of(start, geometry)
    samples = tuple(mechanism.samples(log) for log in logs)
    free = np.flatnonzero(mechanism.free)
    rows = [regression_rows(mechanism, start.theta, item, free, settings) for item in samples]
    total = log_observability(mechanism, rows)
    refuse_blind(mechanism, total)
    parts = tuple(
        _part_report(mechanism, start.theta, item.name, part, row)
        for item, row in zip(samples, rows, strict=True)
        for part in mechanism.parts(item)
    )
    force = fit(
        *(mechanism, samples, start.theta),
        first=rows,
        robust=robust,
        settings=settings,
        progress=progress,
    )
    final = force
    if output_error:
        from identification.fitting.output_error import (
            refine,
        )  # numba, which the force fit does without

        final = refine(mechanism, samples, force, settings=settings, progress=progress)
    course = recursive_course(mechanism, force, settings) if recursive else None
    of = kind_of(start)
    model = of.fitted_model(
        mechanism,
        final,
        name=name,
        logs=tuple(log.reference for log in logs),
        errors=_errors(mechanism, final, samples, seed, output_error, settings),
        provenance=provenance,
    )
    told = (line for log in logs for line in log.warnings)
    warnings = (*told, *_fit_warnings(mechanism, final), *of.warnings(model))
    return Identification(
        *(model, final, force, mechanism, samples, parts, total, course, warnings, settings)
    )


def _part_report(
    mechanism: Mechanism, theta: Array, name: str, part: Part, rows: Rows
) -> PartReport:
    inside = rows.between(part.start, part.end)
    seen = log_observability(mechanism, [inside])
    estimates = block_estimates(mechanism, theta, inside, seen)
    return PartReport(name, part.kind, part.start, part.end, seen, estimates)


def _errors(
    mechanism: Mechanism,
    final: Fit,
    samples: Sequence[Samples],
    seed: int,
    with_velocity: bool,
    settings: FitSettings,
) -> dict[str, Any]:
    """Errors on the very logs of the fit; the velocity error only where a free run was made."""
    noise = [NoiseLevel.of(item, settings) for item in samples]
    traces = [force_traces(mechanism, final.theta, item, settings) for item in samples]
    floors = [
        force_floor(mechanism, final.theta, item, trace, level, seed, settings)
        for item, trace, level in zip(samples, traces, noise, strict=True)
    ]
    found: dict[str, Any] = {
        "force_error": add_up(map(Squares.of, traces)).ratio,
        "noise_floor": {"force_error": add_up(floors).ratio},
    }
    if with_velocity:
        speed = [Squares.of(velocity_traces(mechanism, final.theta, item)) for item in samples]
        found["velocity_error"] = add_up(speed).ratio
    return found


def _fit_warnings(mechanism: Mechanism, fitted: Fit) -> list[str]:
    return [
        f"{mechanism.parameter_names[fitted.free[k]]} stopped at its physical bound: "
        "the data pull it further, so something else is missing from the model"
        for k in fitted.bounded
    ]
