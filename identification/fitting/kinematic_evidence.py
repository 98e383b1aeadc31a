"""What the wheels and a pose say of kinematics, without any force: evidence of its own.

Four wheel speeds have three degrees of freedom: what no rigid motion explains of them shows a wheel
that rolls, or is measured, otherwise than the others. A pose shows more: how far the platform came
for what its wheels turned.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.fitting.cross_validation import CrossValidation, cross_validate, make_folds
from identification.fitting.gauge import gauge_basis
from identification.fitting.regression import Indices, Regression, covariance_of
from identification.fitting.settings import FitSettings
from identification.fitting.swinging_speeds import late_speeds, swings_of_speeds
from identification.mechanisms.mechanism import HeldDirections, Mechanism
from identification.mechanisms.samples import Samples, averaged_down, rolled_speeds
from identification.signals.filters import block_mean, pieces
from identification.signals.noise import white_noise
from identification.threads import give_back, side_by_side
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CONTACT, SPEED
from youbot_env.physics.hardware import WHEEL_WORDS

Array = NDArray[np.float64]

OF_A_POSE = ("way", "turn", "direction", "tracked ahead", "tracked to the left")
"""What a pose does not tell apart from kinematics: a column each, see :class:`_MeasuredWay`."""

NUISANCES = len(OF_A_POSE)


def kinematic_effects(mechanism: Mechanism) -> list[str]:
    """Names of the effects in its catalogue that change how joints roll or speeds are logged."""
    # Where no direction of the speeds is left over, there is nothing to judge them by.
    if not mechanism.internal:
        return []
    return [item.name for item in mechanism.catalogue if item.acts_at in (CONTACT, SPEED)]


@dataclass(frozen=True)
class KinematicFit:
    """What kinematics leaves of all logs at theta (P,), in units of its noise.

    own : indices of the parameters that are fitted to it
    longest_sample : [s] between two samples of a log
    rows : per log; residual (n, E) of the identity and, with a pose, of its three increments;
        columns (n, E, K + F) of the pose's nuisances and of ``own``
    """

    mechanism: Mechanism
    theta: Array
    own: Indices
    rows: tuple[Regression, ...]
    longest_sample: float
    settings: FitSettings

    @cached_property
    def _basis(self) -> Array:
        """(K + F, Q) directions that can be seen."""
        seen = gauge_basis(self.mechanism.holding(()), self.own)
        size = NUISANCES + len(seen)
        basis = np.zeros((size, NUISANCES + seen.shape[1]))
        basis[:NUISANCES, :NUISANCES] = np.eye(NUISANCES)
        basis[NUISANCES:, NUISANCES:] = seen / self._own_scale[:, None]
        return basis

    @property
    def _own_scale(self) -> Array:
        return self.mechanism.scale[self.own]

    @cached_property
    def held_out(self) -> CrossValidation:
        """One least-squares step from theta, judged on each log that was left out."""
        residual = [row.residual for row in self.rows]
        columns = [row.columns for row in self.rows]
        folds = make_folds(self.rows, (), self.settings)
        return cross_validate(residual, columns, folds, self._basis, self.settings)

    @property
    def square(self) -> float:
        """Sum of the squared held-out residuals."""
        return self.held_out.square

    @property
    def mean_square(self) -> float:
        """Of a residual, held out; 1 for white noise alone."""
        return self.square / sum(part.size for part in self.held_out.residual)

    @property
    def step(self) -> Array:
        """(F,) least-squares step of its own parameters."""
        return self.held_out.step[NUISANCES:]

    @cached_property
    def covariance(self) -> Array:
        """(F, F) of its own parameters, true for correlated residuals."""
        scale = np.concatenate([np.ones(NUISANCES), self._own_scale])
        # At the minimum: what the nuisances explain is no noise.
        step = self.held_out.step
        rows = [replace(r, residual=r.residual - r.columns @ step) for r in self.rows]
        found = covariance_of(rows, scale[:, None] * self._basis, scale, self.settings)
        return found[NUISANCES:, NUISANCES:]

    @property
    def p_value(self) -> float:
        """Chance that parameters of zero would come out as far from it (Wald's test)."""
        from scipy.stats import chi2  # slow to load

        seen = self.seen
        if not len(seen):
            return 1.0
        sizes = seen @ (self.theta[self.own] * self._own_scale)
        scale = seen * self._own_scale
        spread = scale @ self.covariance @ scale.T
        distance = float(sizes @ np.linalg.pinv(spread, hermitian=True) @ sizes)
        return float(chi2.sf(distance, len(seen)))

    @cached_property
    def seen(self) -> Array:
        """(k, F) orthonormal directions of its own scaled parameters that are settled here."""
        columns = np.concatenate([row.columns.reshape(-1, len(self._basis)) for row in self.rows])
        known, own = columns[:, :NUISANCES], columns @ self._basis[:, NUISANCES:]
        # What the nuisances explain of a column is no evidence.
        weights, *_ = np.linalg.lstsq(known, own, rcond=None)
        left = own - known @ weights
        power, directions = np.linalg.eigh(left.T @ left)
        deviation = np.sqrt(self.mean_square / np.maximum(power, 1e-300))
        settled = deviation < self.settings.kinematics.max_seen_deviation
        scaled = self._own_scale[:, None] * self._basis[NUISANCES:, NUISANCES:]
        return (scaled @ directions[:, settled]).T

    @property
    def size(self) -> float:
        """Largest of its own parameters, or difference of relative ones, in catalogue sizes."""
        scaled = self.theta[self.own] * self._own_scale
        relative = any(self.mechanism.labels[k].group for k in self.own)
        return float(np.ptp(scaled) if relative else np.abs(scaled).max())


class KinematicEvidence:
    """Wheels and poses of some logs, against which kinematics can be fitted.

    Logs that are too short to tell their noise are left out; ``logs`` may then be empty.

    Parameters
    ----------
    mechanism, theta : at which the noise of the rows is measured
    """

    def __init__(
        self,
        mechanism: Mechanism,
        theta: Array,
        logs: Sequence[Samples],
        settings: FitSettings = FitSettings(),
    ) -> None:
        known = settings.kinematics
        long = [item for item in logs if len(item) * item.dt > known.min_duration]
        self.logs = [averaged_down(item, known.max_sample_rate) for item in long]
        self._longest_sample = max((item.dt for item in long), default=0.0)
        self.settings = settings
        self._first = mechanism, theta

    @cached_property
    def _ways(self) -> list[_MeasuredWay | None]:
        """Per log what its pose says; None without a measured one."""
        size_of = self.settings.kinematics.row_size
        return [
            _MeasuredWay.of(item.pose, size_of(item.dt)) if item.pose_measured else None
            for item in self.logs
        ]

    @cached_property
    def noise(self) -> list[Array]:
        """Per log (E,) white noise of the rows, from their own high frequencies."""
        found = [self._rows(*self._first, log)[0] for log in range(len(self.logs))]
        noise = [white_noise(part, settings=self.settings.noise) for part in found]
        known = self.settings.kinematics
        least = np.array([known.min_noise, *[known.min_pose_noise] * 3])
        return [np.maximum(level, least[: len(level)]) for level in noise]

    def at(self, mechanism: Mechanism, theta: Array, effects: Sequence[str] = ()) -> KinematicFit:
        """What is left at theta (P,), with columns of the effects' parameters."""
        labels = mechanism.labels
        chosen = [k for k, label in enumerate(labels) if label.component in effects]
        own = np.array([k for k in chosen if mechanism.free[k]], dtype=np.intp)
        rows = [
            self._regression(mechanism, theta, log, noise, own)
            for log, noise in enumerate(self.noise)
        ]
        return KinematicFit(mechanism, theta, own, tuple(rows), self._longest_sample, self.settings)

    def fitted(self, mechanism: Mechanism, theta: Array, effects: Sequence[str]) -> KinematicFit:
        """The same where the effects' parameters leave least, within their bounds."""
        lower, upper = mechanism.bounds
        here = self.at(mechanism, theta, effects)
        for _ in range(self.settings.kinematics.steps):
            theta = here.theta.copy()
            theta[here.own] += here.step
            here = self.at(mechanism, np.clip(theta, lower, upper), effects)
        return here

    def _regression(
        self, mechanism: Mechanism, theta: Array, log: int, noise: Array, own: Indices
    ) -> Regression:
        samples = self.logs[log]
        residual, nuisances = self._rows(mechanism, theta, log)
        columns = [nuisances]
        for index in own:
            step = mechanism.labels[index].parameter.difference
            moved = np.tile(theta, (2, 1))
            moved[:, index] += (step, -step)
            ahead, behind = (self._rows(mechanism, there, log)[0] for there in moved)
            # What the parameter explains is taken from the residual.
            columns.append((behind - ahead)[..., None] / (2 * step))
        step = self.settings.kinematics.row_size(samples.dt) * samples.dt
        time = samples.time[0] + step * np.arange(1, len(residual) + 1)
        scaled = np.concatenate(columns, axis=-1) / noise[:, None]
        return Regression(time, step, residual / noise, scaled)

    def _rows(self, mechanism: Mechanism, theta: Array, log: int) -> tuple[Array, Array]:
        """What kinematics leaves (n, E) [rad/s and, of a pose, m, m, rad]; nuisances (n, E, K)."""
        samples, way = self.logs[log], self._ways[log]
        size = self.settings.kinematics.row_size(samples.dt)
        slips, places = list[Array](), list[Array]()
        integral = _WayOfWheels(samples.dt)
        for begin, twist, speed in _rolled_pieces(mechanism, theta, samples, size, self.settings):
            slips.append(block_mean(slip_of_joints(mechanism, theta, twist, speed), size))
            if way is not None:
                places.append(integral.after(way.in_world(twist, begin))[::size])
        slip = np.concatenate(slips)[:, None]
        if way is None:
            return slip, np.zeros((*slip.shape, NUISANCES))
        left, known = way.beyond(np.concatenate(places))
        count = min(len(slip), len(left))
        residual = np.concatenate([slip[:count], left[:count]], axis=1)
        return residual, np.concatenate([np.zeros((count, 1, NUISANCES)), known[:count]], axis=1)


def slip_rows(
    mechanism: Mechanism, theta: Array, samples: Samples, size: int, settings: FitSettings
) -> Array:
    """(n,) [rad/s] means over ``size`` samples of :func:`slip_of_joints`."""
    rolled = _rolled_pieces(mechanism, theta, samples, size, settings)
    slips = (slip_of_joints(mechanism, theta, twist, speed) for _, twist, speed in rolled)
    return np.concatenate([block_mean(slip, size) for slip in slips])


def _rolled_pieces(
    mechanism: Mechanism, theta: Array, samples: Samples, size: int, settings: FitSettings
) -> Iterator[tuple[int, Array, Array]]:
    """First sample, twist (N, A) and speeds (N, J) of pieces of whole rows, as theta says."""
    where = (mechanism.structure, mechanism.geometry, theta, samples, mechanism.settings)
    most = size * max(1, settings.kinematics.max_samples_at_once // size)
    for begin in range(0, len(samples), most):
        yield begin, *rolled_speeds(*where, slice(begin, begin + most))


def slip_of_joints(mechanism: Mechanism, theta: Array, twist: Array, speed: Array) -> Array:
    """(N,) [rad/s] sum with signs of what no rigid motion explains in the joints' speeds.

    Of a platform's four wheels it is phi_1' + phi_2' - phi_3' - phi_4'.

    Parameters
    ----------
    twist, speed : (N, A) and (N, J), corrected for what theta says of kinematics
    """
    rates = dynamics.joint_rates(np, mechanism.structure, mechanism.geometry, theta, tuple(twist.T))
    apart = speed - np.stack(rates, axis=1)
    return np.asarray(apart @ np.array(mechanism.internal), np.float64)


def leaders_of(before: KinematicFit, tried: Mapping[str, KinematicFit]) -> tuple[str, ...]:
    """The effects that explain wheels and pose, alike and best; empty if none of them matters."""
    settings, square = before.settings.kinematics, before.square
    least = min(fit.square for fit in tried.values())
    fall = square - least
    if fall < settings.min_explained_share * square:
        return ()
    most = least + settings.max_tied_share * fall
    found = {name: fit for name, fit in tried.items() if fit.square <= most and _is_firm(fit)}
    # One large enough to matter is enough: rollers that stand askew by a third of a degree do to
    # the speeds what wheels do that differ by 2 %, so each may be what is there.
    if all(fit.size < settings.min_size_share for fit in found.values()):
        return ()
    return tuple(sorted(found, key=lambda name: found[name].square))


def _is_firm(fit: KinematicFit) -> bool:
    """Whether a fitted effect is significant, and none that every log has."""
    settings, mechanism = fit.settings.kinematics, fit.mechanism
    if fit.p_value > settings.max_p_value:
        return False
    if not mechanism.structure.filters_speed:
        return True
    # Speeds that are means over a sample are late by half of it: that is how they are made.
    still = (0.0,) * len(mechanism.joints)
    _, lags = dynamics.logged_speed(np, mechanism.structure, fit.theta, still, still, 0.0)
    return float(np.max(lags)) > fit.longest_sample


@dataclass(frozen=True)
class SlippingWheels:
    """What no rigid motion explains in the wheels of some logs, beyond noise.

    share : root mean square, of that of the wheel speeds; 0 without such a check
    slips : per log (N,), whether a wheel slips then
    bursts : per log (N,), whether it slips by more than rollers mostly ripple
    swings : joints whose speeds swing with their own angle, where this is most of it, with the
        amplitude as a share of the speed
    late : joints whose speeds come after the others', where this is most of it, with the delay [s]
    """

    share: float
    slips: tuple[NDArray[np.bool_], ...]
    bursts: tuple[NDArray[np.bool_], ...]
    swings: Mapping[str, float] = field(default_factory=dict)
    late: Mapping[str, float] = field(default_factory=dict)


def slipping_wheels(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    speed_noise: Sequence[Array],
    settings: FitSettings = FitSettings(),
) -> SlippingWheels:
    """Where wheels slip that roll as theta says.

    Parameters
    ----------
    speed_noise : per log (J,) white noise of a speed [rad/s]
    """
    if not mechanism.internal:
        none = tuple(np.zeros(len(item), bool) for item in logs)
        return SlippingWheels(0.0, none, none)
    known, internal = settings.kinematics, np.array(mechanism.internal)
    squares, masks = list[Array](), list[list[NDArray[np.bool_]]]()
    long, rows = list[Samples](), list[Array]()
    square = sum(
        float(np.vdot(item.wheel_speed[part], item.wheel_speed[part]))
        for item in logs
        for part in pieces(len(item))
    )
    usual = np.sqrt(square / sum(item.wheel_speed.size for item in logs))
    usual = float(usual * np.linalg.norm(internal))
    for item, level in zip(logs, speed_noise, strict=True):
        size = known.row_size(item.dt)
        if len(item) < size:
            masks.append([np.zeros(len(item), bool)] * 2)
            continue
        slip = slip_rows(mechanism, theta, item, size, settings)
        long.append(item)
        rows.append(slip)
        noise = float(np.linalg.norm(internal * level)) / np.sqrt(size)
        squares.append(np.maximum(slip**2 - noise**2, -(noise**2)))
        both = []
        for least in (known.min_slip_share, known.min_burst_share):
            far = np.abs(slip) > max(known.slip_deviations * noise, least * usual)
            mask = np.repeat(far, size)
            # Samples that fill no row are as the last one.
            both.append(np.pad(mask, (0, len(item) - len(mask)), mode="edge"))
        masks.append(both)
    excess = float(np.mean(np.concatenate(squares))) if squares else 0.0
    share = float(np.sqrt(max(excess, 0.0))) / max(usual, 1e-300)
    slips, bursts = zip(*masks, strict=True)
    late: Mapping[str, float] = {}
    swings: Mapping[str, float] = {}
    if share > known.min_slip_share:
        seen = long, rows, internal, mechanism.joints, known
        late = late_speeds(*seen)
        swings = {} if late else swings_of_speeds(*seen)
    return SlippingWheels(share, slips, bursts, swings, late)


class _WayOfWheels:
    """The integral of a velocity (N, 3) by trapezoids, as `integral_of`, piece after piece."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._last: Array | None = None
        self._total = np.zeros((1, 3))

    def after(self, velocity: Array) -> Array:
        """(n, 3) the integral at the samples of the next piece, whose velocity is given."""
        known = velocity if self._last is None else np.concatenate([self._last, velocity])
        steps = 0.5 * self._dt * (known[1:] + known[:-1])
        total = np.cumsum(np.concatenate([self._total, steps]), axis=0)
        self._total = total[-1:]
        first = self._last is None
        self._last = velocity[-1:]
        return total if first else total[1:]


@dataclass(frozen=True)
class _MeasuredWay:
    """What a pose (N, 3) says of the way that a platform went, from row to row.

    A pose may differ by other things than kinematics: a scale of its way and one of its turns
    (lengths of the geometry), the direction that it calls ahead, and the place that it tracks.

    cosine, sine : (N,) of the heading; into_body : (n, 3, 3)
    came : (n, 3) increments of the pose [m, m, rad], in the body frame
    ahead, left : (n, 3) what a place that is tracked 1 m ahead and to the left adds to these
    """

    cosine: Array
    sine: Array
    into_body: Array
    came: Array
    ahead: Array
    left: Array

    @classmethod
    def of(cls, pose: Array, size: int) -> _MeasuredWay:
        """Of a pose of which every so many samples are a row."""
        cosine, sine, yaw = np.cos(pose[:, 2]), np.sin(pose[:, 2]), pose[::size, 2]
        into_body = _turned(0.5 * (yaw[1:] + yaw[:-1]))
        c, s = cosine[::size], sine[::size]
        places = (pose[::size], np.column_stack([c, s, 0 * c]), np.column_stack([-s, c, 0 * c]))
        steps = [np.einsum("nij,nj->ni", into_body, np.diff(place, axis=0)) for place in places]
        return cls(cosine, sine, into_body, *steps)

    def in_world(self, twist: Array, begin: int) -> Array:
        """A body twist (N, 3), from a sample on, along the axes of the world."""
        rows = slice(begin, begin + len(twist))
        c, s = self.cosine[rows], self.sine[rows]
        vx, vy, turning = twist.T
        return np.column_stack([c * vx - s * vy, s * vx + c * vy, turning])

    def beyond(self, place: Array) -> tuple[Array, Array]:
        """Increments (n, 3) beyond those of the wheels, which went to ``place``; (n, 3, K)."""
        went = np.einsum("nij,nj->ni", self.into_body, np.diff(place, axis=0))
        straight, turn = went * (1.0, 1.0, 0.0), went * (0.0, 0.0, 1.0)
        aside = np.column_stack([-went[:, 1], went[:, 0], 0 * went[:, 0]])
        known = np.stack([straight, turn, aside, self.ahead, self.left], axis=-1)
        return self.came - went, known


def _turned(yaw: Array) -> Array:
    """(n, 3, 3) from the world's frame into the body's."""
    c, s, zero = np.cos(yaw), np.sin(yaw), 0.0 * yaw
    rows = [[c, s, zero], [-s, c, zero], [zero, zero, zero + 1.0]]
    return np.moveaxis(np.array(rows), -1, 0)


def held_by(found: KinematicFit, effect: str) -> HeldDirections:
    """The directions of an effect's parameters, in the effect's order, that are settled.

    The effect's parameters are the last ones of those that the fit has.
    """
    count = sum(label.component == effect for label in found.mechanism.labels)
    _, sizes, rows = np.linalg.svd(found.seen[:, -count:], full_matrices=False)
    return HeldDirections(effect, tuple(tuple(row) for row in rows[sizes > 0.5].tolist()))


def doubts_of_kinematics(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    speed_noise: Sequence[Array],
    settings: FitSettings = FitSettings(),
) -> list[str]:
    """What speaks against the kinematics of a model, in sentences; nothing where nothing does."""
    names = [n for n in kinematic_effects(mechanism) if n not in mechanism.structure.effects]
    if not names:
        return []
    # Without what earlier uses of the samples keep: smoothed channels of an hour take much.
    evidence = KinematicEvidence(mechanism, theta, [replace(item) for item in logs], settings)
    if not evidence.logs:
        return []
    before = evidence.at(mechanism, theta)
    give_back()

    def fitted(name: str) -> KinematicFit:
        start = mechanism.extend_theta(theta, name, {})
        return evidence.fitted(mechanism.extended(name), start, [name])

    tried = dict(zip(names, side_by_side(fitted, names), strict=True))
    leaders = leaders_of(before, tried)
    if leaders:
        share = 1.0 - tried[leaders[0]].square / before.square
        return [
            f"the wheels do not roll as the model says: {' or '.join(leaders)} would explain "
            f"{share:.0%} of what no rigid motion or pose does; `youbot diagnose` gives its size"
        ]
    slip = slipping_wheels(mechanism, theta, logs, speed_noise, settings)
    if slip.share <= settings.kinematics.min_slip_share:
        return []
    return [TellingSlip(slip.share, swings=slip.swings, late=slip.late).words]


@dataclass(frozen=True)
class TellingSlip:
    """Slip of wheels that is worth a word.

    share : of the wheel speeds that is no rigid motion, root mean square
    bursts : how often they slip, where they do so now and then; 0 where slip lasts
    square_ratio : usual mean square of the force residual in a burst, over that elsewhere
    swings, late : see `SlippingWheels`; they are what is there then, and no wheel slips
    imitators : effects that would act like it, but not where no wheel slips
    """

    share: float
    bursts: int = 0
    square_ratio: float = 1.0
    swings: Mapping[str, float] = field(default_factory=dict)
    late: Mapping[str, float] = field(default_factory=dict)
    imitators: tuple[str, ...] = ()

    @property
    def brief(self) -> str:
        """In a headline."""
        if self.late:
            return _words_of_late(self.late)
        if self.swings:
            return words_of_swings(self.swings)
        if not self.bursts:
            return f"the wheels slip ({self.share:.1%} of their speeds is no rigid motion)"
        return f"the wheels slip now and then ({self.bursts} times)"

    @property
    def words(self) -> str:
        """With what to do, and with what would act like it."""
        if not self.imitators:
            return self._cure
        names = " and ".join(name.replace("_", " ") for name in self.imitators)
        return f"{self._cure} ({names} would act like it, but not where no wheel slips)"

    @property
    def _cure(self) -> str:
        """What it is, and what to do."""
        if self.late:
            return (
                f"{_words_of_late(self.late)}: it breaks the rigid motion of the wheels as slip "
                "would; log the four speeds of one instant, filtered alike"
            )
        if self.swings:
            return f"{words_of_swings(self.swings)}: {CURE_OF_SWINGS}"
        if not self.bursts:
            return (
                f"the wheels slip: {self.share:.1%} of the wheel speeds is no rigid motion, beyond "
                "noise and kinematics; mend what `youbot doctor` says of their speeds, if it does; "
                "else drive more gently, or on a floor with more grip"
            )
        return (
            f"the wheels slip now and then: {self.bursts} times their speeds are no rigid motion, "
            f"and the squares of the force error are then {self.square_ratio:.1f} times as large "
            "as elsewhere; drive more gently, or on a floor with more grip"
        )


def _words_of_late(late: Mapping[str, float]) -> str:
    """Whose speeds come after or before the others', and by how much."""
    parts = [
        f"velocity_{joint} comes {1e3 * abs(delay):.2g} ms {'after' if delay > 0 else 'before'}"
        for joint, delay in late.items()
    ]
    return f"{' and '.join(parts)} the other wheels' speeds"


CURE_OF_SWINGS = (
    "the encoder is out of centre, or the wheel is out of round; that is no rigid motion, and errs "
    "in force as a friction would; look how the encoder and the wheel sit on the axle"
)
"""What swings mean, and what to do."""


def words_of_swings(swings: Mapping[str, float]) -> str:
    """Whose speeds swing with their angle, and by how much."""
    parts = [f"{WHEEL_WORDS.get(joint, joint)} by {size:.1%}" for joint, size in swings.items()]
    return f"speeds swing with the wheel's own angle ({', '.join(parts)})"
