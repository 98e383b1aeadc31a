"""From logs to a model with standard deviations: the whole identification in one function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from identification.fitting.clocks import placed_on_clock
from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    add_up,
    force_traces,
    velocity_traces,
)
from identification.fitting.estimate_history import EstimateHistory, recursive_course
from identification.fitting.final_fit import coarse_speed_warnings, without_noise_bias
from identification.fitting.held_channels import logs_to_fit
from identification.fitting.kinematic_evidence import doubts_of_kinematics
from identification.fitting.late_efforts import late_efforts
from identification.fitting.least_squares import Fit, fit
from identification.fitting.misfit import NEXT_COMMAND, misfit_warning
from identification.fitting.observability import (
    Observability,
    block_estimates,
    combinations,
    log_observability,
    refuse_blind,
    told_apart_at_rest,
)
from identification.fitting.physical_fit import within_limits
from identification.fitting.predictability import (
    NoiseFloor,
    Predictability,
    noise_floor,
    predictability,
    too_short,
)
from identification.fitting.regression import Regression, regressions
from identification.fitting.settings import FitSettings
from identification.logs.log import Log, shared_clock, warnings_of_logs
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of
from identification.mechanisms.residual_maps import refuse_unseen_logs
from identification.mechanisms.samples import Samples
from identification.showing import Shown
from identification.threads import in_one_blas_thread
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

    def to_dict(self, cutoff: float) -> dict[str, Any]:
        """JSON form; ``cutoff``: share of a blind direction from which a parameter is named."""
        return {
            "log": self.log,
            "kind": self.kind,
            "from": self.start,
            "to": self.end,
            **self.observability.to_dict(cutoff),
            "block_estimates": {
                name: {"value": value, "std": std} for name, (value, std) in self.estimates.items()
            },
        }


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """Result of :func:`identify`.

    Attributes
    ----------
    model : the fitted model (Model or AxisModel), with covariance, logs and errors
    fit : theta, covariance and residual rows behind it
    force : fit on forces; the same as ``fit`` without an output-error step
    predictable : what of the force residual can still be predicted; floor : what noise leaves
    parts : what each stretch of the logs shows; ``total``: all of them together
    course : the recursive estimator's estimates over time, or None
    settings : all numbers that the fit depends on
    warnings : plain sentences: of the logs, of the misfit, of all else
    misfit : the first of them, where the model lacks something: no interval is stated then
    told_first : how many of them, from the first, are of the logs and the misfit
    at_rest : parameters that only standstill tells apart: no interval is stated of these
    """

    model: Any
    fit: Fit
    force: Fit
    mechanism: Mechanism
    samples: tuple[Samples, ...]
    predictable: Predictability
    floor: NoiseFloor
    parts: tuple[PartReport, ...]
    total: Observability
    course: EstimateHistory | None = None
    warnings: tuple[str, ...] = field(default_factory=tuple)
    settings: FitSettings = field(default_factory=FitSettings)
    misfit: str | None = None
    told_first: int = 0
    at_rest: tuple[str, ...] = ()
    kind: ClassVar[str] = "identification"

    def summary(self) -> str:
        """How well the model fits, and what to do about it."""
        errors = self.model.errors
        noise = errors["noise_floor"]["force_error"]
        line = f"{self.model.name}, {len(self.fit.free)} parameters fitted: force error "
        line += f"{errors['force_error']:.2%} (noise {noise:.2%})"
        return f"{line}; {self.misfit}" if self.misfit else f"{line}: it fits"

    def rows(self) -> list[dict[str, Any]]:
        """Parameters with their standard deviations and 95 % intervals."""
        return [
            {
                "parameter": name,
                "value": entry["value"],
                "std": entry["std"],
                "low": entry["interval"] and entry["interval"][0],
                "high": entry["interval"] and entry["interval"][1],
                "unit": entry["unit"],
            }
            for name, entry in self._parameters().items()
        ]

    @property
    def first_warnings(self) -> tuple[str, ...]:
        """What makes all numbers doubtful: what is wrong with the logs, and the misfit."""
        return self.warnings[: self.told_first]

    def with_next_command(self, command: str) -> Identification:
        """The same, with the command to type next in the place of its pattern."""
        warnings = tuple(line.replace(NEXT_COMMAND, command) for line in self.warnings)
        misfit = self.misfit and self.misfit.replace(NEXT_COMMAND, command)
        return replace(self, warnings=warnings, misfit=misfit)

    def to_dict(self) -> dict[str, Any]:
        """JSON form: parameters with 95 % intervals, observability, errors, warnings."""
        cutoff = self.settings.min_direction_share
        return {
            "combinations": self._combinations(),
            "parameters": self._parameters(),
            "errors": dict(self.model.errors),
            "observability": {
                "total": self.total.to_dict(cutoff),
                "parts": [part.to_dict(cutoff) for part in self.parts],
            },
            "recursive": self._last_estimates(),
            "logs": [dict(log) for log in self.model.logs],
            "settings": self.settings.to_dict(),
            "misfit": self.misfit,
            "warnings": list(self.warnings),
        }

    def _parameters(self) -> dict[str, Any]:
        """Value, unit, standard deviation and interval of each parameter; None where unknown.

        Where the model lacks something no interval would hold, so none is stated.
        """
        # Rounding can make the variance of an unseen direction slightly negative.
        variance = np.maximum(np.diag(self.model.covariance), 0.0)
        std = dict(zip(self.model.covariance_names, np.sqrt(variance), strict=True))
        reach = self.settings.interval_deviations
        units = {name: estimate.unit for name, estimate in _estimates(self.model).items()}
        found = {}
        for name, value in self.model.values.items():
            known = std.get(name)
            interval = None
            if known is not None and self.misfit is None and name not in self.at_rest:
                interval = [value - reach * known, value + reach * known]
            found[name] = {"value": value, "unit": units[name], "std": known, "interval": interval}
        return found

    def _combinations(self) -> dict[str, Any]:
        """The same of sums that are known better than their members."""
        reach, told = self.settings.interval_deviations, {}
        for name, (value, std, unit) in combinations(
            self.mechanism, self.fit, self.settings
        ).items():
            interval = None if self.misfit else [value - reach * std, value + reach * std]
            told[name] = {"value": value, "unit": unit, "std": std, "interval": interval}
        return told

    def _last_estimates(self) -> dict[str, float] | None:
        """The recursive estimator's last estimates, by name."""
        if self.course is None:
            return None
        names = [self.mechanism.parameter_names[k] for k in self.force.free]
        return dict(zip(names, self.course.theta[-1].tolist(), strict=True))


def _without_deviations(model: AnyModel) -> AnyModel:
    return model.with_values({})


def _estimates(model: Any) -> dict[str, Any]:
    return dict(model.parameters) | {
        f"{effect}.{name}": estimate
        for effect, parameters in model.effects.items()
        for name, estimate in parameters.items()
    }


@in_one_blas_thread
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

    A model is returned whenever the logs show one. Where something is missing from it, it is fitted
    within physical limits, and ``misfit`` says so.

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
    mechanism = mechanism_of(start, geometry, settings.mechanism)
    samples, notes, _ = logs_to_fit(
        *(mechanism, logs, settings),
        most=settings.max_samples,
        least_rate=settings.min_sample_rate,
        purpose="a fit needs",
    )
    refuse_unseen_logs(mechanism, start.theta, samples)
    samples = tuple(placed_on_clock(mechanism, start.theta, samples, settings))
    free = np.flatnonzero(mechanism.free)
    rows = regressions(mechanism, start.theta, samples, free, settings)
    total = log_observability(mechanism, rows, settings)
    doubt = _doubt_unless_blind(mechanism, start.theta, rows, total, settings)
    moved = told_apart_at_rest(mechanism, samples, rows, total, settings)
    force = fit(
        *(mechanism, samples, start.theta),
        first=rows,
        robust=robust,
        settings=settings,
        progress=progress,
    )
    force = within_limits(mechanism, force, settings)
    final, refused = _last_fit(
        *(mechanism, samples, force, seed, settings, progress), output_error, robust
    )
    predictable = predictability(mechanism, force.rows, samples, seed, settings, force.theta)
    floor = _floor(mechanism, force, samples, predictable, settings)
    kind = kind_of(start)
    errors = _errors(mechanism, final, samples, floor, output_error, settings)
    misfit = misfit_warning(
        *(errors["force_error"], errors["noise_floor"]["force_error"]),
        real=not predictable.is_noise,
    )
    model = kind.fitted_model(
        mechanism,
        final,
        name=name,
        logs=tuple(log.reference for log in logs),
        errors=errors,
        provenance={**(provenance or {}), "clock": shared_clock(logs)},
    )
    # What is wrong with a log may be why the model does not fit it.
    late = late_efforts(
        mechanism, final.theta, samples, settings, seed, predictable.systematic_share
    )
    of_logs = [*warnings_of_logs(logs), late.words if late else ""]
    doubts = [line for line in (doubt, *of_logs, misfit) if line]
    doubts += [too_short(predictable)] if predictable.is_short and not misfit else []
    doubts += [*notes, *coarse_speed_warnings(samples, final)]
    noise = [NoiseLevel.of(item, settings).speed for item in samples]
    doubts += doubts_of_kinematics(mechanism, final.theta, samples, noise, settings)
    return Identification(
        *(model, final, force, mechanism, samples, predictable, floor),
        parts=_part_reports(mechanism, start.theta, samples, rows, settings),
        total=total,
        course=_course(mechanism, force, settings) if recursive else None,
        warnings=(
            *doubts,
            *_rest_warnings(mechanism, moved, settings),
            *refused,
            *_fit_warnings(mechanism, final),
            # Deviations that do not hold cannot tell what the logs show.
            *kind.warnings(_without_deviations(model) if misfit else model, settings.mechanism),
        ),
        settings=settings,
        misfit=misfit,
        told_first=len(doubts),
        at_rest=_hidden(moved, settings),
    )


def _doubt_unless_blind(
    mechanism: Mechanism,
    theta: Array,
    rows: Sequence[Regression],
    total: Observability,
    settings: FitSettings,
) -> str:
    """What speaks for a wrong unit, or nothing.

    Raises
    ------
    InputError
        If the logs cannot show the model: with the motion that would, or the unit.
    """
    doubt = _doubt_of_unit(mechanism, theta, rows, settings)
    try:
        refuse_blind(mechanism, total, settings)
    except InputError:
        if not doubt:
            raise
        # A wrong unit makes what is there too small to see: no motion is missing.
        unseen = total.describe_blind(settings.min_direction_share)[0]
        raise InputError(f"{doubt}; as they stand these logs cannot show {unseen}") from None
    return doubt


def _last_fit(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    force: Fit,
    seed: int,
    settings: FitSettings,
    progress: Callable[[], None],
    output_error: bool,
    robust: bool,
) -> tuple[Fit, list[str]]:
    """The fit of forces, refined in free run or corrected for noise; and why it was not."""
    if output_error:
        return _refined(mechanism, samples, force, settings, progress)
    if robust:  # simulation and extrapolation would give the outliers their weight back
        return force, []
    noise = [NoiseLevel.of(item, settings) for item in samples]
    args = (mechanism, samples, noise, force, seed, settings, progress)
    return without_noise_bias(*args), []


def _doubt_of_unit(
    mechanism: Mechanism, theta: Array, rows: Sequence[Regression], settings: FitSettings
) -> str:
    """What the least-norm parameters of the rows at theta (P,) say of a wrong unit."""
    free = np.flatnonzero(mechanism.free)
    scale = mechanism.scale[free]
    columns = np.concatenate([r.columns.reshape(-1, len(free)) for r in rows]) / scale
    residual = np.concatenate([r.residual.ravel() for r in rows])
    found, rounding = theta.copy(), settings.min_singular_value_share
    found[free] += np.linalg.lstsq(columns, residual, rcond=rounding)[0] / scale
    return mechanism.conventions.doubt_of_unit(mechanism.geometry, found, mechanism.settings)


def _hidden(moved: Observability | None, settings: FitSettings) -> tuple[str, ...]:
    """Names of the parameters in the directions that motion alone does not show."""
    if moved is None:
        return ()
    large = np.abs(moved.blind).max(axis=0) > settings.min_direction_share
    return tuple(name for name, hidden in zip(moved.names, large, strict=True) if hidden)


def _rest_warnings(
    mechanism: Mechanism, moved: Observability | None, settings: FitSettings
) -> list[str]:
    if moved is None:
        return []
    return [
        f"{' and '.join(_hidden(moved, settings))} are told apart by standstill alone, where "
        "friction may hold anything: no interval is stated of them; "
        f"{mechanism.advice(moved.blind[0])}"
    ]


def _refined(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    force: Fit,
    settings: FitSettings,
    progress: Callable[[], None],
) -> tuple[Fit, list[str]]:
    """The fit in free run; the fit on forces and a warning where that is no start for one."""
    # Imported here: it loads numba, which takes half a second and which a force fit does not need.
    from identification.fitting.output_error import refine

    try:
        found = refine(mechanism, samples, force, settings=settings, progress=progress)
    except InputError as error:
        return force, [f"no fit in free run, the one on forces stands: {error}"]
    return within_limits(mechanism, found, settings), []


def _course(mechanism: Mechanism, force: Fit, settings: FitSettings) -> EstimateHistory:
    scale = mechanism.scale[force.free]
    return recursive_course(force.rows, force.theta[force.free], scale, force.std, settings)


def _part_reports(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    rows: Sequence[Regression],
    settings: FitSettings,
) -> tuple[PartReport, ...]:
    """What each stretch of the logs shows, from their rows at theta (P,)."""
    reports = []
    for item, row in zip(samples, rows, strict=True):
        for part in mechanism.parts(item):
            inside = row.between(part.start, part.end)
            seen = log_observability(mechanism, [inside], settings)
            estimates = block_estimates(mechanism, theta, inside, seen, settings)
            place = (item.name, part.kind, part.start, part.end)
            reports.append(PartReport(*place, seen, estimates))
    return tuple(reports)


def _floor(
    mechanism: Mechanism,
    force: Fit,
    samples: Sequence[Samples],
    predictable: Predictability,
    settings: FitSettings,
) -> NoiseFloor:
    traces = [force_traces(mechanism, force.theta, item, settings) for item in samples]
    return noise_floor(
        *(mechanism, force.theta, samples, force.rows, predictable, traces), settings=settings
    )


def _errors(
    mechanism: Mechanism,
    final: Fit,
    samples: Sequence[Samples],
    floor: NoiseFloor,
    with_velocity: bool,
    settings: FitSettings,
) -> dict[str, Any]:
    """Errors on the very logs of the fit; the velocity error only where a free run was made."""
    traces = [force_traces(mechanism, final.theta, item, settings) for item in samples]
    found: dict[str, Any] = {
        "force_error": add_up(map(SumsOfSquares.of, traces)).ratio,
        "noise_floor": floor.to_dict(),
    }
    if with_velocity:
        speed = [velocity_traces(mechanism, final.theta, item) for item in samples]
        found["velocity_error"] = add_up(map(SumsOfSquares.of, speed)).ratio
    return found


def _fit_warnings(mechanism: Mechanism, fitted: Fit) -> list[str]:
    return [
        f"{mechanism.parameter_names[fitted.free[k]]} stopped at its physical bound: "
        "the data pull it further, so something else is missing from the model"
        for k in fitted.bounded
    ]
