"""Checks that need all four wheels: the no-slip identity, and wheels against pose and gyro."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.logs.findings import Finding, percent
from identification.logs.log import Log
from identification.logs.pose_travel import pose_travel, told_by_pose
from identification.logs.settings import LogSettings
from identification.signals.filters import integral_of, pieces
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_env.physics.hardware import GEAR_RATIO


@dataclass(frozen=True)
class CheckLimits:
    """What cannot be exceeded: speed [rad/s] and effort [N m]; and the platform's geometry."""

    max_speed: float
    max_effort: float
    geometry: Geometry
    settings: LogSettings

    @property
    def no_slip(self) -> NDArray[np.float64]:
        """Unit vector (4,) normal to the wheel speeds of all rigid motions without slip."""
        return no_slip_of(self.geometry)


def no_slip_of(geometry: Geometry) -> NDArray[np.float64]:
    """Unit vector (4,) normal to the wheel speeds of all rigid motions without slip."""
    normal = np.array(geometry.internal)
    return normal / np.linalg.norm(normal)


NO_SLIP = np.array([1.0, 1.0, -1.0, -1.0]) / 2
"""Unit vector (4,) normal to the wheel speeds of all rigid motions without slip.

For these phi_1' + phi_2' = phi_3' + phi_4', wheels in the order of WHEELS.
"""

_DEGREES = 180 / np.pi


def slip_ratio(wheel_speed: NDArray[np.float64], direction: NDArray[np.float64] = NO_SLIP) -> float:
    """Share (root mean square) of the speeds (n, 4) that lies along a unit vector (4,)."""
    total = _usual(wheel_speed)
    return float(np.sqrt(np.mean((wheel_speed @ direction) ** 2))) / max(total, 1e-300)


def _usual(wheel_speed: NDArray[np.float64]) -> float:
    """Root mean square of the length of the speeds (n, 4), whose squares are made in pieces."""
    squares = [(wheel_speed[some] ** 2).sum(axis=1) for some in pieces(len(wheel_speed))]
    return float(np.sqrt(np.concatenate(squares).mean()))


def power_share(log: Log, settings: LogSettings = LogSettings()) -> NDArray[np.float64]:
    """Net over gross power (k,) of each joint, from -1 to 1; positive where friction dominates.

    NaN for a joint with little power, which the others drag along (two wheels in motions I and II):
    the sign of its power says nothing about the sign of its channel.
    """
    power = log.velocity * log.effort
    gross = np.abs(power).mean(axis=0)
    share = power.mean(axis=0) / np.maximum(gross, 1e-300)
    return np.where(gross > settings.driving_share * gross.max(), share, np.nan)


def _identity(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """The identity, and which change of sign, order or scale would make it hold."""
    settings = limits.settings
    ratio = slip_ratio(log.velocity, limits.no_slip)
    noise = float(np.sqrt(np.mean(log.speed_noise**2)))
    along = float(np.sqrt(np.mean((log.velocity @ limits.no_slip) ** 2)))
    measured = (
        f"phi_1' + phi_2' - phi_3' - phi_4' is {percent(ratio)} of the wheel speeds "
        f"({2 * along:.2g} rad/s rms; noise alone makes {2 * noise:.2g})"
    )
    if ratio < settings.max_slip or along < settings.slip_noise_deviations * noise:
        yield Finding("info", measured)
        return
    # A wrong sign is the more common fault, and some wrong signs also look like a wrong scale.
    cure = _sign_cure(log, ratio, settings) or _scale_cure(log.velocity, ratio, settings)
    if cure:
        yield Finding("error", f"the wheels cannot move like that: {measured}", cure=cure)
    elif ratio > settings.impossible_slip:
        cure = "check names, units and signs of the velocity columns"
        yield Finding("error", f"the wheels cannot move like that: {measured}", cure=cure)
    else:
        cure = "the model assumes no slip: drive more gently, or check the velocity columns"
        yield Finding("warning", f"the wheels slip: {measured}", cure=cure)


def unsigned_speeds(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Speeds without their sign: they come down to zero and never go beyond, and nothing fits."""
    settings = limits.settings
    if slip_ratio(log.velocity, limits.no_slip) < settings.max_slip:
        return
    largest = np.abs(log.velocity).max(axis=0)
    small = (np.abs(log.velocity) < settings.small_effort_share * largest).mean(axis=0)
    # Noise at rest may have a sign of its own.
    beyond = -np.quantile(log.velocity, 0.001, axis=0)
    one_way = (beyond <= settings.moving_noise_deviations * log.speed_noise) & (
        small > settings.min_small_share
    )
    if one_way.any():
        names = ", ".join(f"velocity_{w}" for w, one in zip(WHEELS, one_way, strict=True) if one)
        message = f"{names}: never negative though the wheels reverse: the sign is lost"
        yield Finding("error", message, cure="log the speeds with their signs")


def _moments_of_slip(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Short times in which the identity fails: a wheel slips, or its encoder stands still."""
    settings = limits.settings
    window = max(int(settings.slip_time / log.dt), 3)
    count = len(log) // window
    pieces = log.velocity[: count * window].reshape(count, window, len(WHEELS))
    along = np.sqrt(((pieces @ limits.no_slip) ** 2).mean(axis=1))
    usual = float(np.sqrt((log.velocity**2).sum(axis=1).mean()))
    noise = float(np.sqrt(np.mean(log.speed_noise**2)))
    by_noise = settings.slip_noise_deviations * noise
    # Rounding alone may break the identity by as much as one step of the channels.
    steps = np.abs(np.diff(log.velocity, axis=0))
    rounding = max((float(np.min(s[s > 0], initial=np.inf)) for s in steps.T), default=0.0)
    rounding = rounding if np.isfinite(rounding) else 0.0
    slips_a_little = along > max(settings.min_slip_of_still_wheel * usual, by_noise, rounding)
    # A wheel may rest in a motion without slip. If it rests while the identity fails, its encoder
    # is the likely cause.
    still = (np.ptp(pieces, axis=1) == 0) & slips_a_little[:, None]
    slips = along > max(settings.max_slip * usual, by_noise)
    if still.any():
        wheel = int(np.argmax(still.any(axis=0)))
        first = int(log.rows[int(np.argmax(still[:, wheel])) * window])
        seconds = float(still[:, wheel].sum() * window * log.dt)
        signal = log.velocity[:, wheel]
        held = float(pieces[int(np.argmax(still[:, wheel])), 0, wheel])
        message = f"stands still for {seconds:.2g} s while the other wheels go on"
        cure = "cut that part off; check the sensor and its cable"
        if held and held in (signal.min(), signal.max()):
            message, cure = clipped(held, seconds)
        yield Finding("error", message, first, f"velocity_{WHEELS[wheel]}", cure)
    elif slips.any():
        row = int(log.rows[int(np.argmax(along)) * window])
        seconds, most = float(slips.sum() * window * log.dt), 2 * float(along.max())
        message = f"wheels slip for {seconds:.2g} s, by up to {most:.2g} rad/s"
        yield Finding("warning", message, row, cure="cut that part off, or drive more gently")


def clipped(value: float, seconds: float) -> tuple[str, str]:
    """Message and cure for a speed that stays at its largest or least value."""
    message = f"stays at its extreme {value:.4g} for {seconds:.2g} s: the channel is clipped"
    return message, "drive more slowly, or log a channel with a larger range"


def _sign_cure(log: Log, ratio: float, settings: LogSettings) -> str:
    """What to do if other signs or another order would make the identity hold; else ""."""
    # Turning all four signs gives the same ratio, so the first wheel's sign is kept.
    signs = [np.array([1.0, *rest]) / 2 for rest in product((1.0, -1.0), repeat=3)]
    ratios = [slip_ratio(log.velocity, sign) for sign in signs]
    best = int(np.argmin(ratios))
    if ratios[best] > min(settings.max_remaining_slip * ratio, settings.max_slip):
        return ""
    wrong = np.sign(signs[best] * NO_SLIP)
    # The ratio does not tell which side is wrong; the side with fewer wheels is taken.
    wrong *= 1.0 if wrong.sum() >= 0 else -1.0
    # A wrong sign of a speed also makes the wheel's power negative, which names the wheel.
    against = power_share(log, settings) < -settings.max_fed_back_power
    if against.any() and not against.all():
        turned = [wheel for wheel, bad in zip(WHEELS, against, strict=True) if bad]
        return f"multiply {_columns('velocity', turned)} by -1, unless it is the effort there"
    turned = [wheel for wheel, sign in zip(WHEELS, wrong, strict=True) if sign < 0]
    if set(turned) in ({"fl", "br"}, {"fr", "bl"}):
        return "two columns of opposite corners seem swapped: the order is fl, fr, bl, br"
    if set(turned) in ({"fl", "bl"}, {"fr", "br"}):
        return (
            f"multiply {_columns('velocity', ['fl', 'bl'])} and their efforts by -1 (the stock "
            "driver negates the left wheels), unless a front and a back column are swapped"
        )
    return f"multiply {_columns('velocity', turned)} and the effort there by -1"


def _columns(kind: str, wheels: list[str]) -> str:
    return " and ".join(f"{kind}_{wheel}" for wheel in wheels)


def _scale_cure(wheel_speed: NDArray[np.float64], ratio: float, settings: LogSettings) -> str:
    """What to do if another scale of one wheel would make the identity hold; else ""."""
    # The combination of wheels with the least square; NO_SLIP if all scales are right. A wheel that
    # is scaled by s enters it with the weight 1/s.
    values, vectors = np.linalg.eigh(wheel_speed.T @ wheel_speed)
    unique = values[0] < settings.max_scale_eigenvalue * values[1]
    most = min(settings.max_remaining_slip * ratio, settings.max_slip)
    if not unique or slip_ratio(wheel_speed, vectors[:, 0]) > most:
        return ""
    weights = vectors[:, 0] * np.sign(NO_SLIP)
    scale = weights / np.median(weights)
    # Logarithm: a factor of 2 and a factor of 1/2 are equally far off.
    odd = int(np.argmax(np.abs(np.log(np.maximum(np.abs(scale), 1e-9)))))
    others = np.delete(scale, odd)
    if np.abs(others - 1).max() > settings.max_other_scale:
        return ""
    return f"velocity_{WHEELS[odd]} seems off by a factor: multiply it by {scale[odd]:.3g}"


def _turning(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Yaw rate of the wheels against gyro and pose."""
    if log.gyro_z is None and log.pose is None:
        return
    rate = limits.geometry.body_twist(log.velocity)[:, 2]
    if log.gyro_z is not None:
        unit = ("rad/s", _DEGREES, "degrees a second")
        yield from _compare("gyro_z", log.gyro_z, rate, unit, limits.settings)
    if log.pose is not None:
        stride = max(int(limits.settings.pose_time / log.dt), 1)
        turned = np.diff(log.pose[::stride, 2])
        expected = np.diff(integral_of(rate, log.dt)[::stride])
        unit = ("rad", _DEGREES, "degrees")
        yield from _compare("pose_yaw", turned, expected, unit, limits.settings)


def _travel(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """Way that the wheels roll against the way of the pose."""
    if log.pose is None:
        return
    stride = max(int(limits.settings.pose_time / log.dt), 1)
    speed = np.hypot(*limits.geometry.body_twist(log.velocity)[:, :2].T)
    expected = np.diff(integral_of(speed, log.dt)[::stride])
    # Lengths, not components: the pose is in the world's frame and the wheels give the body's.
    way = np.hypot(*np.diff(log.pose[::stride, :2], axis=0).T)
    yield from _compare("pose_x", way, expected, ("m", 1e3, "millimetres"), limits.settings)


UNIT_FACTORS = {
    "turns/s": (2 * np.pi, "6.28319"),
    "rpm": (np.pi / 30, "0.104720"),
    "degrees/s": (np.pi / 180, "0.0174533"),
    "rad/s of the motors": (1 / GEAR_RATIO, f"{1 / GEAR_RATIO:.6g}"),
    "rpm of the motors": (np.pi / 30 / GEAR_RATIO, f"{np.pi / 30 / GEAR_RATIO:.6g}"),
}
"""Units that wheel speeds may be in, by what makes rad/s of them."""


def scale_of_pose(log: Log, limits: CheckLimits) -> Iterator[Finding]:
    """What the pose travels and turns over what the wheels say: radius, time scale or unit."""
    if log.pose is None:
        return
    settings, geometry = limits.settings, limits.geometry
    stride = max(int(settings.scale_time / log.dt), 1)
    beside = pose_travel(log, geometry, settings)
    if beside:
        yield from told_by_pose(beside, settings)
    velocity, pose = log.velocity, log.pose
    if beside and beside.lag:
        rows = round(beside.lag / log.dt)
        count = len(log) - abs(rows)
        velocity, pose = velocity[max(rows, 0) :][:count], pose[max(-rows, 0) :][:count]
    twist, yaw = geometry.body_twist(velocity), pose[:, 2]
    way = _way_beside(twist, pose, stride, log.dt, settings)
    if way is None:
        return
    gain, std = way.gain, way.std
    least = max(settings.min_frame_yaw, settings.scale_deviations * way.askew_std)
    if least < abs(way.askew) <= settings.kinematics.doubtful_frame_yaw:
        yield off_forward(way.askew)
    certain = max(settings.min_scale_difference, settings.scale_deviations * std)
    if abs(gain - 1) < certain:
        return
    if max(gain, 1 / gain) < settings.max_radius_ratio:
        if beside and len(beside.odd_wheels(settings)):
            return  # one wheel is odd, not the radius of all
        radius, reach = geometry.R * gain, settings.interval_deviations * geometry.R * std
        message = (
            f"R = {radius:.5f} +- {reach:.1g} m by the pose (95 %), {geometry.R:g} m by the "
            f"geometry: the pose travels {gain:.3g} times what the wheels roll"
        )
        cure = (
            "youbot kinematics LOG -o FILE writes it for --geometry; or mend the pose; until then "
            f"all intervals are with R = {geometry.R:g} m taken as true"
        )
        yield Finding("warning", message, cure=cure)
        return
    expected = np.diff(integral_of(twist[:, 2], log.dt)[::stride])
    turned = np.diff(yaw[::stride])
    turns = float(expected @ expected) > len(expected) * settings.min_compared_size**2
    alike = turns and abs(float(expected @ turned / (expected @ expected)) / gain - 1)
    # A pose in another unit of length turns as the wheels say; time and speeds scale both.
    if alike > settings.max_other_scale:
        return
    near = settings.max_other_scale
    factors = UNIT_FACTORS | {"m/s of the rim": (1 / geometry.R, f"{1 / geometry.R:.6g}")}
    unit = next((u for u, (f, _) in factors.items() if abs(gain / f - 1) < near), "")
    message = f"the pose travels and turns {gain:.3g} times what the wheels say"
    if unit:
        message += f": velocity_* look like {unit}"
        cure = f"multiply them by {factors[unit][1]}"
    else:
        cure = (
            f"the time column runs {1 / gain:.3g} times as fast as the motion (wall clock beside "
            f"simulated time?): multiply time by {gain:.3g}, or mend the unit of the speeds"
        )
    yield Finding("error", message, column="time" if not unit else "velocity_*", cure=cure)


class _Way(NamedTuple):
    """A pose's way over the one that wheels roll: its gain, and the angle [rad] by which the
    heading of the pose is measured askew, with their standard deviations."""

    gain: float
    std: float
    askew: float
    askew_std: float


def _way_beside(
    twist: NDArray[np.float64],
    pose: NDArray[np.float64],
    stride: int,
    dt: float,
    settings: LogSettings,
) -> _Way | None:
    """A pose (N, 3) beside the twist (N, 3) of the wheels, in pieces of ``stride`` samples; None
    where the wheels hardly roll, or the pose goes nowhere.

    As complex numbers: a heading that is askew turns all ways alike, and shortens none of them.
    """
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    world = np.column_stack([c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]])
    rolled, travelled = (
        np.diff(place[::stride, 0] + 1j * place[::stride, 1])
        for place in (integral_of(world, dt), pose)
    )
    # A point that is tracked beside the middle is swung around by turning.
    swung = np.diff(np.exp(1j * pose[::stride, 2]))
    size = max(float((np.abs(swung) ** 2).sum()), 1e-300)
    rolled = rolled - np.vdot(swung, rolled) / size * swung
    square = float((np.abs(rolled) ** 2).sum())
    if square < len(rolled) * settings.min_compared_size**2:
        return None
    factor = np.vdot(rolled, travelled) / square
    gain = float(np.abs(factor))
    if gain == 0.0:
        return None
    left = travelled - factor * rolled - np.vdot(swung, travelled) / size * swung
    off = np.conj(rolled * factor) * left / gain
    along, across = (float(np.sqrt((part**2).sum())) / square for part in (off.real, off.imag))
    return _Way(gain, along, float(np.angle(factor)), across / gain)


def off_forward(angle: float) -> Finding:
    """That the robot drives at an angle [rad] to the forward of its pose."""
    message = f"the robot drives {np.degrees(angle):+.0f} degrees off the pose's forward"
    cure = "turn the pose's frame (pose_yaw) by that; youbot kinematics says it exactly"
    return Finding("warning", message, cure=cure)


def _compare(
    column: str,
    measured: NDArray[np.float64],
    expected: NDArray[np.float64],
    units: tuple[str, float, str],
    settings: LogSettings,
) -> Iterator[Finding]:
    """Ratio of a sensor to what the wheels say, where the wheels say something.

    ``units``: the right one, the factor from it to one that is often mistaken for it, and that.
    """
    unit, factor, mistaken = units
    far = settings.max_gain_ratio
    size = float(np.sqrt(np.mean(expected**2)))
    if size < settings.min_compared_size:
        return
    gain = float(measured @ expected / (expected @ expected))
    if factor / far < abs(gain) < factor * far:
        cure = f"convert it to {unit}"
        yield Finding("error", f"looks like {mistaken}", column=column, cure=cure)
    elif gain < -1 / far:
        cure = "multiply it by -1, or check the signs of the left and right wheels"
        yield Finding("error", "runs against the wheels", column=column, cure=cure)
    elif not 1 / far < gain < far:
        cure = "check its unit, and signs and order of the wheels' columns"
        message = f"is {gain:.2g} times what the wheels say"
        yield Finding("warning", message, column=column, cure=cure)


CHECKS: tuple[Callable[[Log, CheckLimits], Iterator[Finding]], ...] = (
    _identity,
    _moments_of_slip,
    scale_of_pose,
    _turning,
    _travel,
)


@dataclass(frozen=True)
class Slip:
    """phi_1' + phi_2' - phi_3' - phi_4' = 0 checked on a log.

    ratio : share (root mean square) of the wheel speeds that no rigid motion explains
    noise : what white noise of the speeds alone would make of it
    exceeds_noise : whether there is more than noise
    """

    ratio: float
    noise: float
    exceeds_noise: bool

    def to_dict(self) -> dict[str, float | bool]:
        """JSON form."""
        return asdict(self)


def slip_of(
    log: Log, geometry: Geometry | None = None, settings: LogSettings = LogSettings()
) -> Slip | None:
    """The identity on a log; None for a mechanism that has no such four wheels."""
    if tuple(log.joints) != WHEELS:
        return None
    usual = _usual(log.velocity)
    ratio = slip_ratio(log.velocity, no_slip_of(geometry or Geometry()))
    noise = float(np.sqrt((log.speed_noise**2).mean())) / max(usual, 1e-300)
    exceeds = ratio > max(settings.slip_noise_ratio * noise, settings.negligible_slip)
    return Slip(ratio, noise, exceeds)
