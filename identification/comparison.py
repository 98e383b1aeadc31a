"""Model against measurements: errors by log and axis, noise floors, and where the model fails."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.fitting.changed_parameters import (
    NO_DEVIATIONS,
    ParameterChanges,
    changed_parameters,
)
from identification.fitting.clocks import placed_on_clock, words_of_clock
from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    Traces,
    add_up,
    force_traces,
    white_force_floor,
)
from identification.fitting.final_fit import without_noise_bias
from identification.fitting.kinematic_evidence import doubts_of_kinematics
from identification.fitting.late_efforts import late_efforts
from identification.fitting.least_squares import Fit, fit as fit_model
from identification.fitting.misfit import force_floor_of, misfit, misfit_warning
from identification.fitting.observability import log_observability, refuse_blind
from identification.fitting.parts import give_back_after
from identification.fitting.predictability import (
    NoiseFloor,
    NoiseOfForces,
    Predictability,
    noise_of_forces,
    predictability,
    velocity_floors,
)
from identification.fitting.regression import Regression, regression, regressions
from identification.fitting.settings import FitSettings
from identification.logs.columns import joint_columns
from identification.logs.log import Log
from identification.logs.wheel_checks import Slip, slip_of
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, kind_of, mechanism_of, platform_geometry
from identification.mechanisms.residual_maps import refuse_unseen_logs
from identification.mechanisms.samples import Samples, without_angles
from identification.residual_map.residual_map import residual_map
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import ResidualMap
from identification.showing import Shown
from identification.signals.filters import pieces
from identification.threads import in_one_blas_thread
from youbot_env.errors import InputError, Settings, check_settings
from youbot_env.files import write_atomically
from youbot_env.physics.geometry import Geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ComparisonSettings(Settings):
    """What a comparison depends on, beside the model.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    fit: FitSettings = field(default_factory=FitSettings)
    residual_map: ResidualMapSettings = field(default_factory=ResidualMapSettings)
    stretch_duration: float = field(
        default=5.0,
        metadata={
            "unit": "s",
            "reason": "of a stretch that is judged alone: about one period of a calibration motion",
        },
    )
    max_free_run_ratio: float = field(
        default=1e6,
        metadata={
            "unit": "largest measured speed",
            "reason": "beyond it a free run has diverged; its squares would overflow",
        },
    )
    max_stretches: int = field(
        default=8,
        metadata={"unit": "1", "reason": "worst stretches that are listed: what one reads"},
    )

    def __post_init__(self) -> None:
        check_settings(self, "comparison settings", positive=True)


@dataclass(frozen=True)
class LogComparison:
    """One log beside the model's predictions.

    _joint_speed : makes :attr:`joint_speed`, which of a long log takes memory
    """

    log: Log
    axes: tuple[str, ...]
    seen_in_fit: bool
    force: Traces
    velocity: Traces
    force_floor: SumsOfSquares
    velocity_floor: SumsOfSquares
    _joint_speed: Callable[[], Array]
    slip: Slip | None = None

    @property
    def joint_speed(self) -> Array:
        """(N, k) of the free run, as the joints' speeds would be logged."""
        return self._joint_speed()

    @property
    def diverges(self) -> bool:
        """Whether the free run does: it then has no velocity error."""
        return not bool(np.isfinite(self.velocity.predicted).all())


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Result of :func:`compare`; model: as given, a Model or an AxisModel.

    floor: what noise leaves, of all logs; where: which variables the residual depends on;
    kinematics: what speaks against the model's kinematics, in sentences;
    clock: what was read from the logs of when they began, in sentences;
    changes: the model's parameters beside those that fit these logs;
    geometry: that replaced the model's own, or None;
    settings: all numbers that this depends on.
    """

    model: Any
    logs: tuple[LogComparison, ...]
    floor: NoiseFloor
    where: ResidualMap = field(default_factory=lambda: ResidualMap(()))
    changes: ParameterChanges = field(default_factory=ParameterChanges)
    settings: ComparisonSettings = field(default_factory=ComparisonSettings)
    geometry: Geometry | None = None
    kinematics: tuple[str, ...] = ()
    clock: tuple[str, ...] = ()
    kind: ClassVar[str] = "comparison"

    def summary(self) -> str:
        """Both errors beside the noise floor, and what to do about them."""
        found = self.to_dict()
        error, floor = found["total"], found["noise_floor"]
        line = (
            f"{self.model.name} on {len(self.logs)} log{'s' * (len(self.logs) > 1)}: force error "
            f"{error['force_error']:.2%} (noise {floor['force_error']:.2%}), velocity error "
            f"{error['velocity_error']:.2%} (noise {floor['velocity_error']:.2%})"
        )
        return f"{line}; {found['misfit']}" if found["misfit"] else f"{line}: it fits"

    def rows(self) -> list[dict[str, Any]]:
        """Errors of each log."""
        return [
            {
                "log": item.log.name,
                "force error": SumsOfSquares.of(item.force).ratio,
                "velocity error": SumsOfSquares.of(item.velocity).ratio,
                "seen in fit": item.seen_in_fit,
            }
            for item in self.logs
        ]

    @property
    def counted(self) -> tuple[LogComparison, ...]:
        """Logs in the totals: those that the fit has not seen, or all if it has seen all."""
        # Errors on logs of the fit are too small.
        unseen = tuple(item for item in self.logs if not item.seen_in_fit)
        return unseen or self.logs

    def to_dict(self) -> dict[str, Any]:
        """JSON form, as the design fixes it."""
        counted = self.counted
        force_error = add_up(SumsOfSquares.of(item.force) for item in counted).ratio
        floor = add_up(item.force_floor for item in counted).ratio
        return {
            "logs": {item.log.name: _log_dict(item) for item in self.logs},
            "diverges": [item.log.name for item in self.logs if item.diverges],
            "misfit": misfit_warning(force_error, floor, settings=self.settings.fit),
            "total": {
                "force_error": force_error,
                "velocity_error": add_up(SumsOfSquares.of(item.velocity) for item in counted).ratio,
            },
            "noise_floor": {
                "force_error": floor,
                "velocity_error": add_up(item.velocity_floor for item in counted).ratio,
                "force_error_std": self.floor.relative_std * floor,
                "correlation_time": self.floor.correlation_time,
            },
            "where": self.where.to_list(),
            "where_words": self.where.words(
                misfit(force_error, floor, self.settings.fit), self.settings.residual_map
            ),
            "changes": self.changes.to_dict(),
            "kinematics": list(self.kinematics),
            "clock": list(self.clock),
            "stretches": self.worst(),
            "settings": self.settings.to_dict(),
        }

    def stretches(self, item: LogComparison) -> list[dict[str, Any]]:
        """Force error and squared residual by axis and stretch of one log, in time's order."""
        return _stretches_of(item, self.settings.stretch_duration)

    def worst(self) -> list[dict[str, Any]]:
        """Stretches with the largest shares of all squared force residual, worst first."""
        found = []
        for item in self.logs:
            found += self.stretches(item)
        everything = sum(row["square"] for row in found)
        for row in found:
            row["share"] = row.pop("square") / everything if everything > 0 else 0.0
        return sorted(found, key=lambda row: -row["share"])[: self.settings.max_stretches]


def _log_dict(item: LogComparison) -> dict[str, Any]:
    force, velocity = SumsOfSquares.of(item.force), SumsOfSquares.of(item.velocity)
    return {
        "force_error": force.ratio,
        "velocity_error": velocity.ratio,
        "force_error_by_axis": dict(zip(item.axes, force.by_axis.tolist(), strict=True)),
        "velocity_error_by_axis": dict(zip(item.axes, velocity.by_axis.tolist(), strict=True)),
        "noise_floor": {
            "force_error": item.force_floor.ratio,
            "velocity_error": item.velocity_floor.ratio,
        },
        "seen_in_fit": item.seen_in_fit,
        **({} if item.slip is None else {"slip": item.slip.to_dict()}),
    }


def _stretches_of(item: LogComparison, duration: float) -> list[dict[str, Any]]:
    time, square = item.force.time, item.force.residual
    square **= 2
    edges = np.arange(time[0], time[-1], duration)
    # Infinity: the last stretch includes the last sample.
    rows = np.searchsorted(time, [*edges, np.inf])
    return [
        {
            "log": item.log.name,
            "axis": axis,
            "from": float(time[a]),
            "to": float(time[b - 1]),
            "force_error": float(np.sqrt(square[a:b, k].mean() / measured[k])),
            "square": float(square[a:b, k].sum()),
        }
        # Relative to the whole log, not to the stretch: a stretch at rest would have a huge error.
        for measured in [(item.force.measured**2).mean(axis=0) + 1e-300]
        for a, b in zip(rows, rows[1:], strict=False)
        for k, axis in enumerate(item.axes)
        if b > a
    ]


@in_one_blas_thread
def compare(
    model: AnyModel,
    logs: Sequence[Log],
    *,
    geometry: Geometry | None = None,
    seed: int = 0,
    progress: Callable[[], None] = lambda: None,
    settings: ComparisonSettings = ComparisonSettings(),
) -> Comparison:
    """Errors of a model on logs, with predictions, and the variables that the residual depends on.

    Nothing is fitted for the errors; all logs make the map. The structure is fitted to the logs for
    the noise floor, and to say whether the parameters have changed since the model was made.

    Parameters
    ----------
    geometry : replaces the model's own
    seed : of the noise floor's random numbers and the map's
    progress : called after each log and after the map
    settings : all numbers that the comparison depends on

    Raises
    ------
    InputError
        If no log is given.
    """
    if not logs:
        raise InputError("no log given: compare needs at least one")
    mechanism = mechanism_of(model, geometry, settings.fit.mechanism)
    samples = mechanism.samples_of(logs, *_clock_of(model))
    refuse_unseen_logs(mechanism, model.theta, samples)
    samples = placed_on_clock(mechanism, model.theta, samples, settings.fit)
    clock = words_of_clock(mechanism, samples, settings.fit)
    # What takes memory of its own goes first, while no traces of long logs are there.
    noise = [NoiseLevel.of(item, settings.fit) for item in samples]
    kinematics = doubts_of_kinematics(
        mechanism, model.theta, samples, [level.speed for level in noise], settings.fit
    )
    late = late_efforts(mechanism, model.theta, samples, settings.fit, seed)
    kinematics += [late.words] if late else []
    where = residual_map(
        *(mechanism, model.theta, samples),
        seed=seed,
        settings=settings.residual_map,
        fit=settings.fit,
    )
    progress()
    fitted = _fitted(mechanism, model.theta, samples, settings.fit)
    left = _left_by(fitted, mechanism, model.theta, samples, seed, settings.fit)
    if not mechanism.structure.depends_on_angle:
        samples = [without_angles(item) for item in samples]
    give_back_after(samples, settings.fit)
    forces, refitted_error = _noise_of_forces(
        mechanism, samples, left, noise, force_floor_of(model), seed, settings.fit
    )
    force, velocity = list[Traces](), list[Traces]()
    for item in samples:
        force.append(force_traces(mechanism, model.theta, item, settings.fit))
        give_back_after(samples, settings.fit)
        velocity.append(_free_run(mechanism, model.theta, item, settings))
        progress()
    # On a log of its own the given model may do better than one that is fitted to all.
    least = [_no_more_than(*pair) for pair in zip(forces.squares, force, strict=True)]
    floor = NoiseFloor(
        tuple(least),
        velocity_floors(mechanism, model.theta, samples, left.rows, forces, velocity, noise, seed),
        left.predictable.noise_std,
        left.predictable.correlation_time,
    )
    give_back_after(samples, settings.fit)
    errors = {
        "force_error": refitted_error,
        "noise_floor": {"force_error": add_up(floor.force).ratio},
    }
    changes = _changes(model, mechanism, samples, fitted, errors, seed, settings.fit)
    seen = {log.get("sha256") for log in model.logs}
    found = [
        LogComparison(
            log=log,
            axes=mechanism.axes,
            # A log made in memory has no hash; two empty hashes are no sign of the same log.
            seen_in_fit=bool(log.sha256) and log.sha256 in seen,
            force=force[k],
            velocity=velocity[k],
            force_floor=floor.force[k],
            velocity_floor=floor.velocity[k],
            _joint_speed=_joint_speed(mechanism, model.theta, samples[k], velocity[k]),
            slip=slip_of(log, platform_geometry(model) if geometry is None else geometry),
        )
        for k, log in enumerate(logs)
    ]
    return Comparison(
        *(model, tuple(found), floor, where, changes, settings, geometry),
        *(tuple(kinematics), tuple(clock)),
    )


def _clock_of(model: AnyModel) -> tuple[dict[str, float] | None, set[str]]:
    """Start and end [s] of the clock of the logs that a model was fitted on, and their hashes."""
    clock = model.provenance.get("clock")
    seen = {str(log.get("sha256")) for log in model.logs}
    # A file may hold anything there.
    numbers = clock if isinstance(clock, dict) else {}
    found = {key: numbers.get(key) for key in ("start", "end")}
    if not all(isinstance(v, (int, float)) and np.isfinite(v) for v in found.values()):
        return None, seen
    return {key: float(value) for key, value in found.items() if value is not None}, seen


def _free_run(
    mechanism: Mechanism, theta: Array, samples: Samples, settings: ComparisonSettings
) -> Traces:
    """Velocity traces; predicted is NaN from where the run diverges, or is too stiff to make."""
    measured = mechanism.measured_speed(samples)
    try:
        predicted = mechanism.free_run(theta, samples)
    except InputError:
        predicted = np.full_like(measured, np.nan)
    # What is far beyond all that was measured would overflow when it is squared.
    # Piece by piece: the sizes of an hour take memory.
    parts = list(pieces(len(predicted)))
    most = settings.max_free_run_ratio * max(np.abs(measured[some]).max() for some in parts)
    sound = np.concatenate([np.abs(predicted[some]).max(axis=1) < most for some in parts])
    if not sound.all():
        predicted = predicted.copy()
        predicted[int(np.argmin(sound)) :] = np.nan
    return Traces(samples.time, measured, predicted)


def _joint_speed(
    mechanism: Mechanism, theta: Array, samples: Samples, velocity: Traces
) -> Callable[[], Array]:
    """What makes (N, k) of the free run, as the joints' speeds would be logged."""
    if mechanism.structure.changes_kinematics:
        return partial(mechanism.free_run_of_joints, theta, samples)
    return partial(mechanism.joint_speed, velocity.predicted)


def _fitted(
    mechanism: Mechanism, theta: Array, samples: Sequence[Samples], settings: FitSettings
) -> Fit | None:
    """The model's structure fitted to the logs; None where they are too short."""
    free = np.flatnonzero(mechanism.free)
    rows = regressions(mechanism, theta, samples, free, settings)
    if sum(len(row.residual) for row in rows) < settings.min_rows_per_parameter * len(free):
        return None
    return fit_model(mechanism, samples, theta, first=rows, settings=settings)


class _Left(NamedTuple):
    """What the structure leaves at theta (P,), fitted to the logs: rows, and their predictability.

    Given parameters' own residual is no measure of the noise: what they miss may be large.
    """

    theta: Array
    rows: Sequence[Regression]
    predictable: Predictability


def _left_by(
    fitted: Fit | None,
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    seed: int,
    settings: FitSettings,
) -> _Left:
    """Of the structure ``fitted`` to the logs, or of the given one where they are too short."""
    if fitted is None:
        none = np.zeros(0, np.intp)
        rows = [regression(mechanism, theta, item, none, settings) for item in samples]
    else:
        rows, theta = list(fitted.rows), fitted.theta
    found = predictability(mechanism, rows, samples, seed, settings, theta)
    return _Left(theta, rows, found)


def _noise_of_forces(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    left: _Left,
    noise: Sequence[NoiseLevel],
    known: float | None,
    seed: int,
    settings: FitSettings,
) -> tuple[NoiseOfForces, float]:
    """What noise leaves of the forces, taken from the same structure fitted to these logs, and its
    force error.

    ``known``: the relative force floor of the logs that the model was made of
    """
    traces = [force_traces(mechanism, left.theta, item, settings) for item in samples]
    elsewhere = []
    if known is not None and not left.predictable.is_noise:  # of noise all is the floor
        args = zip(samples, traces, noise, strict=True)
        elsewhere = [
            _noise_as_known(mechanism, left.theta, *of, known, seed, settings) for of in args
        ]
    found = noise_of_forces(mechanism, samples, left.predictable, traces, settings, elsewhere)
    return found, add_up(SumsOfSquares.of(trace) for trace in traces).ratio


def _noise_as_known(
    mechanism: Mechanism,
    theta: Array,
    samples: Samples,
    traces: Traces,
    noise: NoiseLevel,
    known: float,
    seed: int,
    settings: FitSettings,
) -> Array:
    """(A,) mean square of the noise on a log's forces, as other logs show it: ``known``, relative
    to the forces; not less than its channels' own white noise makes."""
    white = white_force_floor(mechanism, theta, samples, traces, noise, seed, settings)
    measured = SumsOfSquares.of(traces).measured.mean()
    return np.maximum(known**2 * measured, white.residual) / max(len(traces.time), 1)


def _changes(
    model: AnyModel,
    mechanism: Mechanism,
    samples: Sequence[Samples],
    fitted: Fit | None,
    errors: Mapping[str, Any],
    seed: int,
    settings: FitSettings,
) -> ParameterChanges:
    """What the model's structure, ``fitted`` to these logs with errors, says of its parameters."""
    if model.covariance is None:
        return ParameterChanges(reason=NO_DEVIATIONS)
    if fitted is None:
        return ParameterChanges(reason="the logs are too short to refit the model")
    try:
        refuse_blind(mechanism, log_observability(mechanism, fitted.rows, settings), settings)
        noise = [NoiseLevel.of(item, settings) for item in samples]
        last = without_noise_bias(mechanism, samples, noise, fitted, seed, settings)
        refitted = kind_of(model).fitted_model(mechanism, last, name=model.name)
    except InputError:
        return ParameterChanges(reason="these logs do not show all of the model's parameters")
    return changed_parameters(model, replace(refitted, errors=errors), mechanism, settings)


def _no_more_than(floor: SumsOfSquares, traces: Traces) -> SumsOfSquares:
    own = SumsOfSquares.of(traces)
    return SumsOfSquares(np.minimum(floor.residual, own.residual), own.measured)


def write_predictions(path: str | os.PathLike[str], item: LogComparison) -> None:
    """Write the free run's joint speeds [rad/s] as CSV: time as it stands in the log's file.

    One row per row of that file, also where rows were repaired or resampled.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    log = item.log
    time = log.file_time.tolist()
    names, predicted = joint_columns("velocity", log.joints), item.joint_speed
    speeds = np.column_stack(
        [np.interp(time, log.time, predicted[:, k]) for k in range(len(names))]
    )
    lines = [",".join(["time", *names])]
    # repr keeps every digit of a time stamp, so that rows can be matched to those of the log.
    lines += [
        ",".join([repr(t), *(f"{value:.9f}" for value in row)])
        for t, row in zip(time, speeds.tolist(), strict=True)
    ]
    write_atomically(path, "\n".join(lines) + "\n")
