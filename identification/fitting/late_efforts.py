"""Efforts of joints that were logged at other times than those of the others.

A logger that asks one drive after the other, or filters one effort longer, writes a log on which no
model holds: one joint's force comes too late or too soon. A law of that joint's inertia, or of the
others', imitates it. What a delay leaves is known: the effort's own rate, along the way in which
that joint pushes. Only differences count: a delay of all efforts is an effect of the catalogue.

The rates are those of the efforts that the fitted forces demand, which have no noise; so a delay is
found without bias (instrumental variables: Soderstrom and Stoica, System Identification, 1989,
chapter 8). Any inertia and friction of body and joints is fitted beside the delays, so that what
one wheel or one axis has more than the others is no delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.errors import NoiseLevel
from identification.fitting.regression import (
    Regression,
    covariance_of,
    filtered_residual,
    filtered_rows,
    regression,
    rows_by_parts,
)
from identification.fitting.settings import FitSettings
from identification.logs.columns import joint_columns
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, averaged_down
from identification.signals.filters import at_both_ends, slope_ends

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LateEfforts:
    """Efforts that come after the others by one time.

    late, early : their columns; delay [s] between them and its standard deviation [s]
    reach : standard deviations to an end of the 95 % interval
    """

    late: tuple[str, ...]
    early: tuple[str, ...]
    delay: float
    std: float
    reach: float

    @property
    def brief(self) -> str:
        """Which efforts, by how much."""
        few = self._odd
        comes = "comes" if len(few) == 1 else "come"
        side = "after" if few is self.late else "before"
        return (
            f"{' and '.join(few)} {comes} {1e3 * self.delay:.0f} +- "
            f"{max(1e3 * self.reach * self.std, 1.0):.0f} ms (95 %) {side} {self._than}"
        )

    @property
    def cure(self) -> str:
        """What it does, and what to do."""
        late, late_joints = " and ".join(self.late), "the others'"
        if self._odd is self.early:
            late, late_joints = "the others", f"of {' and '.join(self.early)} the"
        return (
            "no motion fits such forces, and a friction or an inertia of single wheels would "
            "imitate it; log all efforts of one instant, filtered alike, or move "
            f"{late} by that time towards the start; if all are of one instant, {late_joints} "
            "drives act late"
        )

    @property
    def _odd(self) -> tuple[str, ...]:
        """Of both groups the smaller one."""
        return self.late if len(self.late) <= len(self.early) else self.early

    @property
    def _than(self) -> str:
        many = max(len(self.late), len(self.early))
        others = self.early if self._odd is self.late else self.late
        return "the other efforts" if many > 2 else " and ".join(others)

    @property
    def words(self) -> str:
        """With what to do."""
        return f"{self.brief}: {self.cure}"

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "late": list(self.late),
            "early": list(self.early),
            "delay": self.delay,
            "interval": [self.delay - self.reach * self.std, self.delay + self.reach * self.std],
        }


def late_efforts(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    settings: FitSettings = FitSettings(),
    seed: int = 0,
    systematic_share: float | None = None,
) -> LateEfforts | None:
    """The efforts that come later than the others; None where nothing says so, or not clearly.

    Parameters
    ----------
    theta : (P,) where the columns of the mechanism's parameters are computed
    seed : of the white noise that the rows are compared with
    systematic_share : of the squares that the model leaves at most, which the motion predicts: the
        rest is noise, also where it is not white. None where nobody has asked
    """
    known, count = settings.late_efforts, len(mechanism.joints)
    if count < 2:
        return None
    slow = (averaged_down(item, known.max_sample_rate) for item in logs)
    each = [_ForceRows(mechanism, theta, item, settings) for item in slow]
    each = [rows for rows in each if len(rows.plain.residual) > 1]
    known_columns = _KnownColumns.of(each, settings)
    if known_columns is None:
        return None
    alike = _fitted(each, known_columns, np.full((count, 1), count**-0.5), settings)
    single = _fitted(each, known_columns, np.eye(count), settings)
    if alike is None or single is None:
        return None
    late, early = _two_groups(single.delay)
    contrast = np.zeros(count)
    contrast[late], contrast[early] = 1.0 / len(late), -1.0 / len(early)
    if not single.shows(contrast):
        return None
    delay = float(contrast @ single.delay)
    std = float(np.sqrt(max(contrast @ single.covariance @ contrast, 0.0)))
    spread = max(float(np.ptp(single.delay[group])) for group in (late, early))
    if delay < max(known.min_delay, known.min_deviations * std) or (
        spread > known.max_spread * delay
    ):
        return None
    noise = sum(rows.noise_square(seed + k) for k, rows in enumerate(each))
    if noise > known.max_noise * alike.square:
        return None  # counted speeds: how much their noise is, is not known
    share = 1.0 if systematic_share is None else systematic_share
    rest = min(alike.square - noise, share * alike.square)
    least = max(known.min_share_of_rest * rest, known.min_fall * alike.square)
    if alike.square - single.square < least:
        return None
    names = joint_columns("effort", mechanism.joints)
    named = [tuple(names[k] for k in sorted(group)) for group in (late, early)]
    return LateEfforts(named[0], named[1], delay, std, settings.interval_deviations)


def _two_groups(delay: Array) -> tuple[list[int], list[int]]:
    """Joints on the late and on the early side of the widest gap between delays (J,)."""
    order = np.argsort(delay)
    cut = 1 + int(np.argmax(np.diff(delay[order])))
    return order[cut:].tolist(), order[:cut].tolist()


class _ForceRows:
    """Rows of one log: of its forces, of what may act at each joint, and of a delay there."""

    def __init__(
        self, mechanism: Mechanism, theta: Array, samples: Samples, settings: FitSettings
    ) -> None:
        self.mechanism, self.theta, self.settings = mechanism, theta, settings
        self.samples = samples.for_fit
        free = np.flatnonzero(mechanism.free)
        self.plain = regression(mechanism, theta, self.samples, free, settings)

    @cached_property
    def _pattern(self) -> Array:
        """(J, A) the force of a torque at each joint."""
        return self.mechanism.jacobian * self.mechanism.force_scale

    @cached_property
    def columns(self) -> Array:
        """(n, A, K) of the model's parameters, and of what else may act that is no delay.

        Any inertia and any viscous friction of body and joints (both are symmetric matrices), dry
        friction of single joints, constant forces of the body and of the world (a slope).
        """
        samples, axes = self.samples, len(self.mechanism.axes)
        usual = np.sqrt((samples.wheel_speed**2).mean(axis=0))
        smooth = np.maximum(self.settings.late_efforts.smooth_share * usual, 1e-12)
        one_way, other_way = np.triu_indices(axes)
        # (M, A, A) that make a basis of the symmetric ones.
        symmetric = np.zeros((len(one_way), axes, axes))
        symmetric[np.arange(len(one_way)), one_way, other_way] = 1.0
        symmetric[np.arange(len(one_way)), other_way, one_way] = 1.0

        def ends_of(part: Samples) -> Array:
            speed = self.mechanism.measured_speed(part)
            constant = [np.ones((len(part), 1))]
            heading = self.mechanism.variables(part).heading
            if heading is not None:
                constant += [np.cos(heading)[:, None], np.sin(heading)[:, None]]
            pull = np.stack(at_both_ends(np.concatenate(constant, axis=1)))
            dry = np.stack(at_both_ends(np.tanh(part.wheel_speed / smooth)))
            found = [
                np.einsum("tna,mba->tnbm", np.stack(at_both_ends(speed)), symmetric),
                np.einsum("tna,mba->tnbm", slope_ends(speed, part.dt), symmetric),
                (pull[:, :, None, None, :] * np.eye(axes)[..., None]).reshape(
                    2, len(part) - 1, axes, -1
                ),
                dry[:, :, None, :] * self._pattern.T,
            ]
            return np.concatenate(found, axis=-1)

        rows = rows_by_parts(ends_of, self.mechanism, self.samples, self.settings)
        return np.concatenate([self.plain.columns, rows], axis=-1)

    def forces(self, torque: Array) -> Array:
        """(n, A) rows of the forces of torques (N, J)."""
        force = self.mechanism.measured_force(replace(self.samples, torque=torque))
        ends = np.stack(at_both_ends(force))
        return filtered_rows(ends, self.mechanism, self.samples, self.settings)

    def moved(self, whole: NDArray[np.intp]) -> Array:
        """(n, A) rows of the forces, each effort read so many samples (J,) later in the log."""
        torque = self.samples.torque
        at = np.arange(len(torque))[:, None] + whole
        inside = np.clip(at, 0, len(torque) - 1)
        return self.forces(np.take_along_axis(torque, inside, axis=0))

    @cached_property
    def demanded(self) -> Array:
        """(n, A) rows of the force that the model demands at theta."""
        return self.forces(self.samples.torque) - self.plain.residual

    def late(self, fitted: Array) -> Array:
        """(n, A, J) what a second of delay adds to the rows, of the fitted forces (n, A)."""
        rate = np.gradient(self.mechanism.joint_torque(fitted), self.plain.step, axis=0)
        # A row at rest is zero: no rate leads to it or away.
        rests = (self.plain.columns == 0.0).all(axis=(1, 2))
        near = rests | np.roll(rests, 1) | np.roll(rests, -1)
        rate = np.where(near[:, None], 0.0, rate)
        return -rate[:, None, :] * self._pattern.T

    def noise_square(self, seed: int) -> float:
        """Squares that white noise of the channels leaves in the rows, a mean over some draws."""
        noise, rng = NoiseLevel.of(self.samples, self.settings), np.random.default_rng(seed)
        squares = list[float]()
        for _ in range(self.settings.late_efforts.noise_draws):
            noisy = self.mechanism.noisy(self.samples, noise.speed, noise.torque, rng)
            again = filtered_residual(self.mechanism, self.theta, noisy, self.settings)
            squares.append(float(((again - self.plain.residual) ** 2).sum()))
        return float(np.mean(squares))


@dataclass(frozen=True)
class _KnownColumns:
    """What explains the rows of all logs without any delay.

    span : (n, K) orthonormal; ends : (logs - 1,) rows after which the next log begins
    shape : (rows, A) of all logs together
    """

    span: Array
    ends: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, each: Sequence[_ForceRows], settings: FitSettings) -> _KnownColumns | None:
        """Of the rows of some logs; None where they are too few."""
        if not each:
            return None
        columns = np.concatenate([rows.columns for rows in each])
        shape, flat = columns.shape[:2], columns.reshape(-1, columns.shape[-1])
        if len(flat) < settings.late_efforts.min_rows * flat.shape[1]:
            return None
        size = np.sqrt((flat**2).mean(axis=0))
        left, sizes, _ = np.linalg.svd(flat[:, size > 0] / size[size > 0], full_matrices=False)
        seen = sizes > settings.min_singular_value_share * sizes[:1].sum()
        ends = np.cumsum([len(rows.plain.residual) for rows in each])[:-1]
        return cls(left[:, seen], ends, shape)

    def beyond(self, signal: Array) -> Array:
        """What they leave of (n, ...)."""
        return signal - self.span @ (self.span.T @ signal)

    def by_log(self, flat: Array) -> list[Array]:
        """(n, ...) as rows (rows, A, ...) of each log."""
        return np.split(flat.reshape(*self.shape, *flat.shape[1:]), self.ends)


@dataclass(frozen=True)
class _DelayFit:
    """Delays (J,) [s] of the efforts, their covariance (J, J), and the squares that are left.

    seen : (J, Q) orthonormal; the directions of the delays that the motion shows
    """

    delay: Array
    covariance: Array
    square: float
    seen: Array

    def shows(self, contrast: Array) -> bool:
        """Whether a sum of delays (J,) is one of those that the motion shows, nearly."""
        unseen = contrast - self.seen @ (self.seen.T @ contrast)
        return bool(np.abs(unseen).max() < 0.1 * np.abs(contrast).max())


def _fitted(
    each: Sequence[_ForceRows], known: _KnownColumns, basis: Array, settings: FitSettings
) -> _DelayFit | None:
    """Delays along an orthonormal basis (J, B), by Gauss and Newton; None where they do not settle.

    Efforts are read later by whole samples, and rates do the rest: to interpolate would smooth
    noise, and any delay would then seem to fit better than none.
    """
    chosen, delay = settings.late_efforts, np.zeros(len(basis))
    steps = [rows.samples.dt for rows in each]
    for _ in range(chosen.max_steps):
        whole = [np.rint(delay / dt).astype(np.intp) for dt in steps]
        rates, unknown = _linearised(each, known, whole)
        taken = [
            (rate @ (dt * by)).ravel() for rate, by, dt in zip(rates, whole, steps, strict=True)
        ]
        target = unknown + known.beyond(np.concatenate(taken))
        columns = np.concatenate([rate.reshape(-1, len(basis)) for rate in rates]) @ basis
        largest = float((columns**2).sum())
        columns = known.beyond(columns)
        power, directions = np.linalg.eigh(columns.T @ columns)
        # A delay of all efforts may be known already: by a lag that the model holds.
        enough = max(chosen.min_eigenvalue * power[-1], chosen.min_power * largest)
        shown = directions[:, power > enough]
        columns = columns @ shown
        sizes = np.linalg.lstsq(columns, target, rcond=None)[0]
        seen = basis @ shown
        delay = seen @ sizes
        if not np.abs(delay).max() < chosen.max_delay:
            return None
        # More than half a sample: a delay between two samples would go to and fro.
        if all(
            np.abs(delay - dt * by).max() < chosen.max_part_of_sample * dt
            for by, dt in zip(whole, steps, strict=True)
        ):
            left = target - columns @ sizes
            covariance = seen @ _covariance(each, known, left, columns, settings) @ seen.T
            return _DelayFit(delay, covariance, float(left @ left), seen)
    return None


def _linearised(
    each: Sequence[_ForceRows], known: _KnownColumns, whole: Sequence[NDArray[np.intp]]
) -> tuple[list[Array], Array]:
    """Per log (n, A, J) what a second of delay adds, and (all,) what the model leaves, where each
    effort is read so many samples (J,) later."""
    force = [rows.moved(by) for rows, by in zip(each, whole, strict=True)]
    beside = [f - rows.demanded for f, rows in zip(force, each, strict=True)]
    unknown = known.beyond(np.concatenate([part.ravel() for part in beside]))
    rates = [
        rows.late(f - rest)
        for rows, f, rest in zip(each, force, known.by_log(unknown), strict=True)
    ]
    return rates, unknown


def _covariance(
    each: Sequence[_ForceRows],
    known: _KnownColumns,
    left: Array,
    columns: Array,
    settings: FitSettings,
) -> Array:
    """(Q, Q) of least squares with columns (n, Q) that leave (n,), true for lasting errors."""
    count = columns.shape[1]
    if not count:
        return np.zeros((0, 0))
    rows = [
        Regression(one.plain.time, one.plain.step, residual, own)
        for one, residual, own in zip(each, known.by_log(left), known.by_log(columns), strict=True)
    ]
    return covariance_of(rows, np.eye(count), np.ones(count), settings)
