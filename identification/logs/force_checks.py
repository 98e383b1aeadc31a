"""Checks of efforts against the motion that they make: zeros, units, and what filters the speeds.

A small regression of the body's forces on its motion, over means of a tenth of a second, stands for
a model: enough to see what no physics of a platform explains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from identification.kinematics.wheel_order import described
from identification.logs.columns import joint_columns
from identification.logs.findings import Finding
from identification.logs.log import Log
from identification.logs.settings import LogSettings
from identification.logs.timebase import runs_of
from identification.logs.wheel_checks import UNIT_FACTORS, CheckLimits
from identification.signals.filters import block_mean, integral_of
from identification.signals.noise import white_noise
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.hardware import GEAR_RATIO, TORQUE_CONSTANT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Means:
    """Means over ``power_time``: twist (n, 3), its rate (n, 3), efforts (n, 4), heading (n,).

    noise : (4,) what white noise leaves in such a mean of an effort, standard deviation
    """

    twist: Array
    rate: Array
    effort: Array
    heading: Array
    step: float
    noise: Array


def _means(log: Log, geometry: Geometry, settings: LogSettings) -> _Means:
    size = max(round(settings.power_time / log.dt), 1)
    twist = geometry.body_twist(block_mean(log.velocity, size))
    step = size * log.dt
    if log.pose is not None:
        heading = block_mean(log.pose[:, 2], size)
    else:
        heading = integral_of(twist[:, 2], step)
    noise = white_noise(log.effort, log.valid, settings.noise) / np.sqrt(size)
    rate, effort = np.gradient(twist, step, axis=0), block_mean(log.effort, size)
    return _Means(twist, rate, effort, heading, step, noise)


def effort_offsets(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Efforts whose zero is not zero: what each wheel's effort has that no motion explains.

    Friction, inertia and the products of speeds are fitted to each wheel, and what a slope does
    with the heading; what pulls one way along the body all the time stays, and is an offset. The
    torques that cancel in the body (a floor that twists the wheels) are none.
    """
    settings = limits.settings
    means = _means(log, limits.geometry, settings)
    seen = _columns_of_wheels(means, limits.geometry, settings)
    # What dry friction holds at a wheel that stands is any effort, and no offset.
    if seen is None or seen[1].sum(axis=0).min() < settings.min_offset_rows:
        return
    columns, turns = seen
    found = _offsets_in(columns, turns, means, limits)
    if found is None:
        return
    names = joint_columns("effort", log.joints)
    told = ", ".join(f"{name} {size:+.2g}" for name, size in zip(names, found, strict=True))
    # A friction that is larger one way than the other has a mean of its own.
    one_way = np.column_stack([columns, np.abs(means.twist @ limits.geometry.wheel_jacobian.T)])
    if _offsets_in(one_way, turns, means, limits) is None:
        message = f"the efforts have offsets, or a friction is larger one way: {told} N m"
        cure = "diagnose tries torque_offset and asymmetric_friction; take offsets alone off"
    else:
        message = f"the efforts have offsets, which no motion explains: {told} N m"
        cure = "take them off (zero of the current sensors); diagnose tries torque_offset"
    yield Finding("warning", message, cure=cure)


def _offsets_in(
    columns: Array, turns: NDArray[np.bool_], means: _Means, limits: CheckLimits
) -> Array | None:
    """(4,) offsets of the efforts [N m] beside what columns (n, p), the constant first, explain of
    each wheel where it ``turns`` (n, 4); None where none is sure and large enough."""
    settings = limits.settings
    lag = round(settings.offset_memory / means.step)
    wheels = zip(means.effort.T, turns.T, strict=True)
    found = np.array([_constant(columns[rows], effort[rows], lag) for effort, rows in wheels])
    unseen = limits.no_slip
    value, std = found[:, 0] - unseen * (found[:, 0] @ unseen), found[:, 1]
    usual = np.sqrt((means.effort**2).mean(axis=0))
    # Where the regression explains nearly all of each wheel, its deviations hold; friction, which
    # seldom is in one wheel alone, makes them too small.
    fits = found[:, 2].max() < settings.max_left_of_efforts
    deviations = settings.sure_offset_deviations if fits else settings.offset_deviations
    least = np.maximum(deviations * std, settings.min_offset_share * usual)
    # A constant part of a channel is no larger than its root mean square: what is fitted larger
    # stands against other columns, which the motion hardly tells from it.
    if (np.abs(value) < least).all() or (np.abs(value) > settings.max_offset_share * usual).any():
        return None
    return found[:, 0]


def efforts_at_rest(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Efforts that are the same, and not zero, whenever the wheels stand."""
    settings = limits.settings
    slow = np.abs(log.velocity) <= settings.resting_deviations * log.speed_noise
    still = np.asarray(slow.all(axis=1))
    least = max(round(settings.min_rest_time / log.dt), 2)
    rests = [(a, b) for a, b in runs_of(still) if b - a >= least]
    # Friction may hold anything at a single stop; before the first motion it holds nothing.
    if len(rests) < 2 and not (rests and rests[0][0] == 0):
        return
    at = np.array([log.effort[a:b].mean(axis=0) for a, b in rests])
    noise = white_noise(log.effort, log.valid, settings.noise)
    usual = np.sqrt((log.effort**2).mean(axis=0))
    value = np.median(at, axis=0)
    size = np.maximum(settings.min_rest_share * usual, noise)
    alike = (np.abs(at - value) < 0.5 * np.abs(value)).all(axis=0)
    told = [
        f"{name} {one:+.2g}"
        for name, one, far in zip(
            joint_columns("effort", log.joints), value, alike & (np.abs(value) > size), strict=True
        )
        if far
    ]
    if told:
        message = f"at rest the efforts are not zero: {', '.join(told)} N m"
        cure = "their zero is off (take it off), or the drives hold against brakes or a slope"
        row = int(log.rows[rests[0][0]])
        yield Finding("warning", message, row, cure=cure)


def low_passed_speeds(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Speeds whose noise fades like behind a low-pass: seen where no motion is, in the identity."""
    settings = limits.settings
    steps = np.diff(log.file_time)
    if float(np.ptp(steps)) > settings.max_step_offset * log.dt:
        return  # interpolated to even times, which colours noise
    signal = log.velocity @ limits.no_slip
    signal = signal - signal.mean()
    total = float(signal @ signal)
    if not total:
        return
    decay = float(signal[1:] @ signal[:-1]) / total
    if not settings.min_noise_decay < decay < settings.max_noise_decay:
        return
    lags = np.arange(2, 6)
    found = np.array([float(signal[k:] @ signal[:-k]) / total for k in lags])
    mean = np.maximum(1 - (1 - decay) * lags, 0.0)
    time, how = 0.0, ""
    if np.abs(found - decay**lags).max() < settings.max_decay_error:
        time, how = -log.dt / np.log(decay), "low-passed"
    elif np.abs(found - mean).max() < settings.max_mean_error:
        time, how = log.dt / (1 - decay), "means over as long"
    if how:
        message = (
            f"the noise of velocity_* fades over {1e3 * time:.0f} ms: the speeds are {how}, "
            "or their noise is coloured"
        )
        cure = "log unfiltered speeds; diagnose tries speed_filter and actuator_lag, its twin"
        yield Finding("warning", message, cure=cure)


def _columns_of_wheels(
    means: _Means, geometry: Geometry, settings: LogSettings
) -> tuple[Array, NDArray[np.bool_]] | None:
    """(n, p) what may make an effort, the constant first, and (n, 4) which wheels turn;
    None without motion both ways."""
    twist = means.twist
    size = np.sqrt((twist**2).mean(axis=0))
    moving = size > settings.min_compared_size
    ways = [min(float((way * twist[:, i] > 0).mean()) for way in (1.0, -1.0)) for i in range(3)]
    if not moving.any() or min(np.array(ways)[moving]) < settings.min_share_of_way:
        return None
    wheel = twist @ np.sign(geometry.wheel_jacobian).T
    smooth = np.maximum(settings.moving_speed_share * np.sqrt((wheel**2).mean(axis=0)), 1e-12)
    products = [twist[:, i] * twist[:, j] for i in range(3) for j in range(i, 3)]
    columns = np.column_stack(
        [
            np.ones(len(twist)),
            twist,
            means.rate,
            np.tanh(wheel / smooth),
            *products,
            np.cos(means.heading),
            np.sin(means.heading),
        ]
    )
    return columns, np.abs(wheel) > smooth


def _constant(columns: Array, effort: Array, lag: int) -> tuple[float, float, float]:
    """Value and standard deviation (Newey and West) of the first column's coefficient, and the
    share of the effort's squares that all columns leave."""
    scale = np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
    scaled = columns / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)
    weights = inverse @ (scaled.T @ effort)
    left = effort - scaled @ weights
    scores = (scaled @ inverse[0]) * left
    variance = float(scores @ scores)
    for k in range(1, lag + 1):
        variance += 2 * (1 - k / (lag + 1)) * float(scores[k:] @ scores[:-k])
    share = float(left @ left) / max(float(effort @ effort), 1e-300)
    return float(weights[0] / scale[0]), float(np.sqrt(max(variance, 0.0)) / scale[0]), share


def units_of_motion(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """The unit of the speeds, and of the efforts, by the mass that both show.

    Mass acts by accelerations, in which the speeds' unit stands once, and by products of speed and
    yaw rate, in which it stands twice: the ratio of both masses is the unit. The mass itself is
    then that of a platform, or the efforts' unit is wrong.

    What is missing from masses and friction, a floor that is rough in places, may set the masses
    apart as well. So a log is blamed only where one mass explains the forces in another order or
    unit, and does not as the log stands, or where no platform has such a mass.
    """
    settings, geometry = limits.settings, limits.geometry
    means = _means(log, geometry, settings)
    found = _two_masses(means, geometry)
    if found is None:
        return
    inertial, central, std, left = found
    most, ratio = settings.max_unit_doubt, settings.usual_mass_ratio
    if inertial <= 0 or std > settings.max_mass_std * abs(central):
        return
    doubtful = central <= 0 or not 1 / most < inertial / central / ratio < most
    masses = f"accelerations show a mass of {inertial:.3g} kg, turns one of {central:.3g} kg"
    # A negative mass fits as well as the right one: the sign alone tells the order then.
    enough = 1.1 * left if central < 0 else settings.max_other_order_share * left
    orders = _orders_of_wheels(means, geometry, enough, settings) if doubtful else []
    if orders:
        other = _in_order(means, geometry, orders[0])
        exchanged = f"{', or '.join(map(described, orders))} are exchanged"
        cure = "put velocity_* and effort_* in the order fl, fr, bl, br"
        if _explains_it(means, other, geometry, settings):
            yield Finding("error", f"{masses}: {exchanged}", cure=cure)
        else:
            yield _possible(masses, exchanged, cure)
    if orders or central <= 0:
        return
    number = inertial / central / settings.usual_mass_ratio
    if doubtful:
        unit, factor = _nearest(number, _speed_numbers(geometry))
        cure = f"multiply them by {1 / factor:.6g} to have rad/s of the wheels"
        other = replace(means, twist=means.twist / factor, rate=means.rate / factor)
        explains = _explains_it(means, other, geometry, settings)
        message = f"velocity_* look like {unit}: {masses}"
        if explains:
            yield Finding("error", message, None, "velocity_*", cure)
        elif _is_nearer(inertial * factor, inertial, geometry, settings):
            cure += ", unless something large acts that no mass and no friction explains"
            yield Finding("warning", message, None, "velocity_*", cure)
        else:
            yield _possible(masses, f"velocity_* are {unit}", cure)
    elif not _is_platform(inertial, geometry, settings):
        usual = settings.usual_platform_mass * geometry.bulk
        unit, factor = _nearest(inertial / usual, EFFORT_NUMBERS)
        message = f"effort_* look like {unit}: they show a mass of {inertial:.3g} kg"
        cure = f"multiply them by {1 / factor:.6g} to have N m at the wheels"
        level = "error" if inertial < 4 * geometry.m1 else "warning"
        yield Finding(level, message, None, "effort_*", cure)


def _is_platform(mass: float, geometry: Geometry, settings: LogSettings) -> bool:
    """Whether a platform may have such a mass [kg]."""
    return 4 * geometry.m1 < mass < settings.max_platform_mass * max(1.0, geometry.bulk)


def _is_nearer(mass: float, as_given: float, geometry: Geometry, settings: LogSettings) -> bool:
    """Whether a mass [kg] is much more that of a usual platform than the one of the log."""
    usual = settings.usual_platform_mass * geometry.bulk
    far, as_given_far = (abs(np.log(max(one, 1e-300) / usual)) for one in (mass, as_given))
    return bool(far + np.log(settings.min_nearer_mass) < as_given_far)


def _explains_it(given: _Means, other: _Means, geometry: Geometry, settings: LogSettings) -> bool:
    """Whether one mass explains the forces as others read the log, and much worse as it stands.

    What white noise leaves counts for neither.
    """
    columns = geometry.wheel_jacobian[:, :2]
    total = float(((given.effort @ columns) ** 2).sum(axis=1).mean())
    noise = float((given.noise**2 @ columns**2).sum()) / max(total, 1e-300)
    left, as_given = (_left_by_one_mass(one, geometry, settings) for one in (other, given))
    most = settings.max_other_order_share * max(as_given - noise, 0.0)
    return left < settings.max_left_for_masses and left - noise < most


def _possible(masses: str, fault: str, cure: str) -> Finding:
    """That a log may be at fault, or that something is missing which sets the masses apart."""
    return Finding(
        "info",
        f"{masses}: something large acts that no mass and no friction explains (a floor that is "
        f"rough in places, a torque that is clipped), or else {fault}",
        cure=f"if nothing such is there, {cure}",
    )


EFFORT_NUMBERS = {
    "torques of the motors, before the gear": 1 / GEAR_RATIO,
    "N mm": 1e3,
    "N cm": 1e2,
    "currents in mA": 1e3 / (TORQUE_CONSTANT * GEAR_RATIO),
    "kN m": 1e-3,
}
"""What efforts may be instead: numbers per N m at the wheel."""


def _speed_numbers(geometry: Geometry) -> dict[str, float]:
    """Units that speeds may be in: numbers per rad/s of the wheel."""
    units = {unit: 1 / factor for unit, (factor, _) in UNIT_FACTORS.items()}
    return units | {"m/s of the rim": geometry.R}


def _nearest(number: float, units: dict[str, float]) -> tuple[str, float]:
    name = min(units, key=lambda unit: abs(float(np.log(units[unit] / number))))
    return name, units[name]


def _orders_of_wheels(
    means: _Means, geometry: Geometry, enough: float, settings: LogSettings
) -> list[tuple[int, ...]]:
    """Orders (4,) of the wheels' columns, speeds and efforts alike, that make both masses agree.

    Those with the fewest changes, which leave no more than ``enough`` of the forces. Left and
    right wheels exchanged are a mirrored robot, which moves by the same laws: no force tells it.
    """
    fits = []
    for order in permutations(range(4)):
        found = _two_masses(_in_order(means, geometry, order), geometry)
        if found is None or min(found[:2]) <= 0:
            continue
        number = found[0] / found[1] / settings.usual_mass_ratio
        if max(number, 1 / number) < settings.max_unit_doubt and found[3] <= enough:
            fits.append((found[3], sum(i != k for i, k in enumerate(order)), order))
    best = min(fits)[0] if fits else 0.0
    near = [(moved, order) for share, moved, order in fits if share <= 1.1 * best]
    return [order for moved, order in near if moved == min(near)[0]]


def _in_order(means: _Means, geometry: Geometry, order: tuple[int, ...]) -> _Means:
    """The same with the wheels' columns, speeds and efforts alike, in another order (4,)."""
    chosen = list(order)
    twist, rate = (
        geometry.body_twist((block @ geometry.wheel_jacobian.T)[:, chosen])
        for block in (means.twist, means.rate)
    )
    return replace(means, twist=twist, rate=rate, effort=means.effort[:, chosen])


def _two_masses(means: _Means, geometry: Geometry) -> tuple[float, float, float, float] | None:
    """Mass by accelerations and by products with the yaw rate [kg], the latter's standard
    deviation, and the share of the forces' squares that is left."""
    inertia, centre, others, target = _forces_of_masses(means, geometry)
    columns = np.column_stack([inertia, centre, *others])
    scale = np.sqrt((columns**2).mean(axis=0))
    if not (scale[:2] > 0).all():
        return None
    columns = columns / np.maximum(scale, 1e-300)
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-9)
    weights = inverse @ (columns.T @ target)
    left = target - columns @ weights
    std = float(np.sqrt(inverse[1, 1] * (left @ left) / len(left))) / float(scale[1])
    share = float(left @ left) / max(float(target @ target), 1e-300)
    return float(weights[0] / scale[0]), float(weights[1] / scale[1]), std, share


def _left_by_one_mass(means: _Means, geometry: Geometry, settings: LogSettings) -> float:
    """Share of the forces' squares that is left where both masses have their usual ratio."""
    inertia, centre, others, target = _forces_of_masses(means, geometry)
    columns = np.column_stack([settings.usual_mass_ratio * inertia + centre, *others])
    columns = columns / np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
    weights = np.linalg.pinv(columns.T @ columns, rcond=1e-9) @ (columns.T @ target)
    left = target - columns @ weights
    # A mass is positive.
    known = target if weights[0] <= 0 else left
    return float(known @ known) / max(float(target @ target), 1e-300)


def _forces_of_masses(means: _Means, geometry: Geometry) -> tuple[Array, Array, list[Array], Array]:
    """Columns (2 n,) along X and Y: of a mass by accelerations, and by products with the yaw rate;
    of its place, friction and constant forces; and the forces."""
    force = means.effort @ geometry.wheel_jacobian
    (vx, vy, w), (ax, ay, aw) = means.twist.T, means.rate.T
    zero, one = np.zeros(len(vx)), np.ones(len(vx))
    along = [ax, -vy * w, -(w**2), -aw, vx, np.sign(vx), zero, zero, one, zero]
    across = [ay, vx * w, aw, -(w**2), zero, zero, vy, np.sign(vy), zero, one]
    inertia, centre, *others = (np.concatenate(pair) for pair in zip(along, across, strict=True))
    return inertia, centre, others, np.concatenate([force[:, 0], force[:, 1]])
