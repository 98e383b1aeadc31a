"""Lengths, delay, frame, slip and units of a platform from its logs; needs no torques."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from identification.kinematics.arrangement import (
    exchange_of,
    in_x,
    is_other,
    may_be_other,
    order_in_x,
    other,
    partners,
)
from identification.kinematics.gyro_fit import fit_gyro
from identification.kinematics.motion import Array, Motion, angles_at, fresh_pose
from identification.kinematics.orientation import (
    Orientation,
    clock_lag,
    describe,
    orientation_of,
    pieces_of,
)
from identification.kinematics.pose_fit import PoseFit, fit_pose
from identification.kinematics.settings import KinematicsSettings
from identification.kinematics.slip import SlipFound, identity_share, slip_of_pose
from identification.kinematics.units import SpeedUnit, speed_units
from identification.kinematics.wheels import WheelFit, equalised, fit_wheels
from youbot_env.errors import InputError
from youbot_env.physics.effect import with_unit
from youbot_env.physics.geometry import WHEELS, Geometry


@dataclass(frozen=True)
class Length:
    """A number with unit and standard deviation; value None where the logs do not show it."""

    value: float | None
    unit: str
    std: float | None

    def to_dict(self) -> dict[str, float | str | None]:
        """JSON form."""
        return asdict(self)

    def __str__(self) -> str:
        if self.value is None or self.std is None:
            return "not shown"
        return with_unit(f"{self.value:.5g} +- {self.std:.2g}", self.unit)


@dataclass(frozen=True)
class KinematicFinding:
    """What the estimation found: level (error, warning, info), message, cure, column."""

    level: str
    message: str
    cure: str = ""
    column: str | None = None

    def to_dict(self) -> dict[str, str | None]:
        """JSON form."""
        return asdict(self)


@dataclass(frozen=True)
class Kinematics:
    """Result of `estimate_kinematics`.

    Attributes
    ----------
    parameters : R, L [m], delay [s] (positive where the speeds come late), frame_yaw [rad] (from
        the pose's forward direction to the robot's, counter-clockwise), lever_x, lever_y [m] (the
        tracked point in the robot's frame), R_over_L
    wheels : each wheel's own lengths by name; empty where they are not shown
    slip : as shares of the way
    unit : of the wheel speeds in the log, and gear; None where it is rad/s of the wheel
    counts : of position_* a turn of the wheel, mean; None without positions, or if they are rad
    findings : what is wrong or not shown
    travelled, turned : way [m] and turning [rad] in all
    geometry : with R, and L where it is shown, as found
    """

    parameters: dict[str, Length]
    slip: SlipFound
    findings: list[KinematicFinding]
    travelled: float
    turned: float
    geometry: Geometry
    wheels: dict[str, WheelFit] = field(default_factory=dict)
    unit: SpeedUnit | None = None
    counts: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        found: dict[str, Any] = {
            "parameters": {name: value.to_dict() for name, value in self.parameters.items()},
            "slip": self.slip.to_dict(),
            "wheels": {name: _wheel_entry(wheel) for name, wheel in self.wheels.items()},
            "unit": None,
            "counts_per_turn": self.counts,
            "travelled": self.travelled,
            "turned": self.turned,
            "geometry": asdict(self.geometry),
            "findings": [finding.to_dict() for finding in self.findings],
        }
        if self.unit:
            factor = 1 / self.unit.factor
            found["unit"] = {"name": self.unit.name, "gear": self.unit.gear, "factor": factor}
        return found


def _wheel_entry(wheel: WheelFit) -> dict[str, Any]:
    found = {"radius": Length(wheel.radius[0], "m", wheel.radius[1]).to_dict()}
    if wheel.roller_angle:
        found["roller_angle"] = Length(
            wheel.roller_angle[0], "rad", wheel.roller_angle[1]
        ).to_dict()
    if wheel.arm:
        found["arm"] = Length(wheel.arm[0], "m", wheel.arm[1]).to_dict()
    return found


def estimate_kinematics(
    motions: Sequence[Motion],
    geometry: Geometry | None = None,
    settings: KinematicsSettings = KinematicsSettings(),
) -> Kinematics:
    """Estimate a platform's lengths from motions with a pose, or with a gyro alone.

    Parameters
    ----------
    geometry : nominal lengths of the robot, with which the unit of the speeds is found; without it
        any usual radius of a mecanum wheel will do

    Raises
    ------
    InputError
        If no log has a pose or gyro, nothing moves, or no order of the wheels explains the pose.
    """
    posed = [m for m in motions if m.pose is not None and len(fresh_pose(m, settings))
             >= settings.min_poses]  # fmt: skip
    if posed:
        return _from_pose(posed, geometry, settings)
    turning = [m for m in motions if m.gyro_z is not None and np.isfinite(m.gyro_z).any()]
    if turning:
        return _from_gyro(turning, geometry, settings)
    names = ", ".join(motion.name for motion in motions)
    raise InputError(
        f"{names}: neither pose_x, pose_y, pose_yaw nor gyro_z, which tell lengths of the wheels; "
        "log a pose (motion capture, odometry of a lidar, tf), or a gyro"
    )


@dataclass(frozen=True)
class Aligned:
    """A motion in the right order, axes and clock, as one of a robot in X.

    orientation, lag [s] : how it stood; findings : what was wrong
    geometry : as given, with the other arrangement of the rollers where the motion shows that
    """

    motion: Motion
    orientation: Orientation
    lag: float
    findings: list[KinematicFinding]
    geometry: Geometry


def aligned(
    motion: Motion,
    settings: KinematicsSettings,
    geometry: Geometry | None = None,
) -> Aligned:
    """Find the order, axes and clock of a motion; ``geometry`` None is the youBot's, and unsure."""
    known, geometry = geometry is not None, geometry or Geometry()
    logged, motion = motion, in_x(motion, geometry)
    findings: list[KinematicFinding] = []
    lag = clock_lag(motion, settings)
    found = _best(motion, (0.0, lag), settings, True)
    if found[0].share < settings.min_explained_share:
        other = _best(motion, (0.0, lag), settings, False)
        degrees = _from_degrees(motion)
        turned = _best(degrees, (0.0, lag), settings, True)
        if turned[0].share > max(settings.min_explained_share, other[0].share):
            cure = "convert it to radians (times 0.0174533)"
            told = KinematicFinding("error", "looks like degrees", cure, "pose_yaw")
            findings.append(told)
            motion, found, other = degrees, turned, turned
        clearly = other[0].share - found[0].share > settings.min_better_share
        if clearly and other[0].share > settings.min_explained_share:
            found = other
    orientation, lag = found
    if abs(lag) > settings.max_delay:
        orientation, lag = _finer(motion, orientation, lag, settings)
    message, cure = describe(orientation)
    if message:
        message, cure, shown = _or_rollers(motion, orientation, geometry, known, settings)
        now = f"{100 * orientation.share:.0f} % of the pose's way is explained then"
        findings.append(KinematicFinding("error", f"{message}: {now}", cure))
        if shown != geometry:
            # Once more: the columns are right, and the pose is not mirrored.
            again = aligned(logged, settings, shown)
            return replace(again, findings=[*findings, *again.findings])
    right = orientation.corrected(motion)
    if abs(lag) > settings.max_delay and orientation.share > settings.min_explained_share:
        side = "later" if lag > 0 else "earlier"
        findings.append(
            KinematicFinding(
                "error",
                f"the wheels' clock is {abs(lag):.2f} s {side} than the pose's",
                f"shift the pose by {lag:+.2f} s, or stamp both by one clock",
            )
        )
        right, lag = _shifted(right, lag), 0.0
    return Aligned(right, orientation, lag, findings, geometry)


def _or_rollers(
    motion: Motion,
    found: Orientation,
    geometry: Geometry,
    known: bool,
    settings: KinematicsSettings,
) -> tuple[str, str, Geometry]:
    """What is wrong, its cure, and the geometry; rollers in the other arrangement look like
    exchanged wheels, and only the arm tells them apart."""
    message, cure = describe(found)
    changed = other(geometry)
    if changed is None or not may_be_other(found, geometry, known):
        return message, cure, geometry
    stands = f"the rollers stand in {changed.arrangement}"
    said = f"in {geometry.arrangement} by {_of(known)}"
    which = f'"arrangement": "{changed.arrangement}"'
    mend = f"give a geometry with {which} (youbot kinematics -o FILE writes it)"
    shown = found.g > 0 and _turning(motion) > settings.min_turning
    arm = abs(found.c) / found.g if shown else 0.0
    arm /= units_a_metre(arm, changed, settings) if shown else 1.0
    if not is_other(arm, geometry):
        return f"{message}, or {stands}, not {said}", f"{cure}; or {mend}", geometry
    lengths = "|l - h|" if changed.arrangement == "O" else "l + h"
    why = f"L = {arm:.4g} m is near their {lengths} = {changed.L:.4g} m"
    if known:
        return f"{stands}, {said} ({why})", mend, changed
    if exchange_of(found) != partners(changed):
        changed = replace(changed, l=changed.h, h=changed.l)
    return f"{stands}, {said} ({why}), or {message}", f"{mend}; or {cure}", changed


def _of(known: bool) -> str:
    return "the geometry" if known else "the youBot's geometry (none was given)"


def _best(
    motion: Motion, lags: Sequence[float], settings: KinematicsSettings, only_as_logged: bool
) -> tuple[Orientation, float]:
    found = [
        (orientation_of(pieces_of(motion, lag, settings), settings, only_as_logged), lag)
        for lag in lags
    ]
    return max(found, key=lambda pair: pair[0].share)


def _finer(
    motion: Motion, found: Orientation, lag: float, settings: KinematicsSettings
) -> tuple[Orientation, float]:
    """The lag near a coarse one at which the pose is explained best."""
    near = lag + settings.delay_step * np.arange(-20, 21, 2)
    turned = found.corrected(motion)
    best = _best(turned, near.tolist(), settings, True)
    return replace(found, share=best[0].share), best[1]


def _from_degrees(motion: Motion) -> Motion:
    """The motion with its yaw converted from degrees."""
    assert motion.pose is not None
    return replace(motion, pose=motion.pose * np.array([1.0, 1.0, np.pi / 180]))


def _shifted(motion: Motion, lag: float) -> Motion:
    """The motion with the speeds earlier by ``lag`` [s]."""
    rows = round(lag / motion.dt)
    n = len(motion.time) - abs(rows)
    late, early = slice(max(rows, 0), max(rows, 0) + n), slice(max(-rows, 0), max(-rows, 0) + n)
    assert motion.pose is not None
    return Motion(
        motion.name,
        motion.time[early],
        motion.velocity[late],
        motion.pose[early],
        None,
        None if motion.position is None else motion.position[late],
        None if motion.rows is None else motion.rows[early],
    )


def _from_pose(
    motions: Sequence[Motion], geometry: Geometry | None, settings: KinematicsSettings
) -> Kinematics:
    nominal = geometry or Geometry()
    done, findings, starts, lags = [], [], [], []
    for motion in motions:
        found = aligned(motion, settings, geometry)
        right, orientation, lag, wrong = found.motion, found.orientation, found.lag, found.findings
        nominal = found.geometry if found.geometry != (geometry or Geometry()) else nominal
        if orientation.share < settings.min_related_share:
            raise InputError(
                f"{motion.name}: the pose does not follow the wheels, in no order or sign "
                f"({100 * max(orientation.share, 0):.0f} % of its way is explained); is it the "
                "same run, and are these four mecanum wheels?"
            )
        named = f"{motion.name}: " if len(motions) > 1 else ""
        findings += [replace(one, message=named + one.message) for one in wrong]
        done.append(right)
        starts.append((orientation.c, orientation.g))
        lags.append(lag)
    arm = float(np.median([abs(c) / g if g > 0 else 0.0 for c, g in starts]))
    turned = sum(_turning(motion) for motion in done)
    metre = units_a_metre(arm, nominal, settings) if turned > settings.min_turning else 1.0
    if metre != 1.0:
        name = {100.0: "centimetres", 1000.0: "millimetres"}[metre]
        told = f"pose_x and pose_y look like {name}: L would be {arm:.4g} m"
        findings.append(KinematicFinding("error", told, f"divide them by {metre:g}"))
        done = [_in_metres(motion, metre) for motion in done]
        starts = [(c / metre, g) for c, g in starts]
    c = complex(np.median([s[0].real for s in starts]), np.median([s[0].imag for s in starts]))
    start = np.array(
        [4 * c.real, 4 * c.imag, 0, 0, 4 * np.median([s[1] for s in starts]), np.median(lags)]
    )
    fit = fit_pose(done, start, settings)
    wheels: dict[str, WheelFit] = {}
    try:
        own, covariance = fit_wheels(done, fit, settings)
    except (ValueError, np.linalg.LinAlgError):
        own = None
    if own is not None:
        if _wheels_differ(own, covariance, settings):
            # With equal wheels a twist of one direction would look like one of another.
            done = [replace(m, velocity=equalised(m.velocity, own)) for m in done]
            fit = fit_pose(done, fit.theta, settings)
        wheels = {WHEELS[k]: wheel for k, wheel in zip(order_in_x(nominal), own, strict=True)}
        wheels = {name: wheels[name] for name in WHEELS}
    return _assemble(done, fit, wheels, nominal, geometry is not None, findings, settings)


def _wheels_differ(
    wheels: Sequence[WheelFit], covariance: Array, settings: KinematicsSettings
) -> bool:
    radii = np.array([wheel.radius[0] for wheel in wheels])
    least = settings.wheel_deviations * np.sqrt(np.maximum(np.diag(covariance), 0))
    far = np.abs(radii / radii.mean() - 1) > np.maximum(least, settings.min_wheel_difference)
    return bool(far.any()) or any(_roller_off(wheel, settings, np.pi / 4) for wheel in wheels)


def _roller_off(wheel: WheelFit, settings: KinematicsSettings, said: float) -> bool:
    """Whether the roller's angle is shown and is not what is said [rad]."""
    if wheel.roller_angle is None:
        return False
    angle, std = wheel.roller_angle
    least = max(settings.min_angle_difference, settings.wheel_deviations * std)
    return std < settings.max_angle_std and abs(abs(angle) - said) > least


def _assemble(
    motions: Sequence[Motion],
    fit: PoseFit,
    wheels: dict[str, WheelFit],
    nominal: Geometry,
    known: bool,
    findings: list[KinematicFinding],
    settings: KinematicsSettings,
) -> Kinematics:
    a, b, u, v, g, delay = fit.theta.tolist()
    cov = fit.covariance
    scale, turn = float(np.hypot(a, b)), float(np.arctan2(b, a))
    along, across = np.array([a, b]) / scale, np.array([-b, a]) / scale
    std_scale = float(np.sqrt(along @ cov[:2, :2] @ along))
    std_turn = float(np.sqrt(across @ cov[:2, :2] @ across)) / scale
    travelled = sum(float(r.travelled[-1]) for r in fit.residuals)
    turned = sum(float(r.turned[-1]) for r in fit.residuals)
    if travelled < settings.min_travel and scale > 1e-2:
        findings.append(
            KinematicFinding(
                "warning",
                f"the platform drives {travelled:.2g} m in all: R is hardly shown",
                "drive several metres in each direction",
            )
        )
    arm, std_arm = scale / g if g > 0 else np.inf, np.inf
    if g > 0:
        slope = np.array([along[0] / g, along[1] / g, 0, 0, -scale / g**2, 0])
        std_arm = float(np.sqrt(slope @ cov @ slope))
    shows_arm = std_arm < settings.max_relative_std * arm and turned > settings.min_turning
    unit = _unit(scale, nominal, known, findings, settings)
    factor = unit.factor if unit else 1.0
    rotate = np.exp(-1j * turn) * (u + 1j * v)
    lever_std = np.sqrt(np.diag(cov)[2:4])
    shows_lever = bool((lever_std < settings.max_lever_std).all()) and turned > settings.min_turning
    parameters = {
        "R": Length(scale * factor, "m", std_scale * factor),
        "L": Length(arm, "m", std_arm) if shows_arm else Length(None, "m", None),
        "delay": Length(delay, "s", float(np.sqrt(cov[5, 5]))),
        "frame_yaw": Length(turn, "rad", std_turn),
        "lever_x": Length(rotate.real, "m", float(lever_std[0]))
        if shows_lever
        else Length(None, "m", None),
        "lever_y": Length(rotate.imag, "m", float(lever_std[1]))
        if shows_lever
        else Length(None, "m", None),
    }
    wheels = {
        name: WheelFit(
            (w.radius[0] * factor, w.radius[1] * factor),
            w.roller_angle,
            (w.arm[0], w.arm[1]) if w.arm else None,
        )
        for name, w in wheels.items()
    }
    findings += _length_findings(parameters, nominal, known, turned, settings)
    findings += _wheel_findings(wheels, nominal, settings)
    counts = _counts(motions, delay, factor, settings)
    slip = slip_of_pose(motions, fit.residuals, settings)
    found = _geometry(nominal, parameters, wheels, settings)
    return Kinematics(parameters, slip, findings, travelled, turned, found, wheels, unit, counts)


def units_a_metre(arm: float, nominal: Geometry, settings: KinematicsSettings) -> float:
    """How many units of the pose's length a metre has, by the wheels' arm in them."""
    for metre in (100.0, 1000.0):
        ratio = arm / metre / nominal.L
        if 1 / settings.length_units_ratio < ratio < settings.length_units_ratio:
            return metre
    return 1.0


def _in_metres(motion: Motion, metre: float) -> Motion:
    assert motion.pose is not None
    return replace(motion, pose=motion.pose / np.array([metre, metre, 1.0]))


def _turning(motion: Motion) -> float:
    """Way of the yaw [rad], by its extremes over seconds: noise adds none."""
    assert motion.pose is not None
    yaw = motion.pose[np.isfinite(motion.pose[:, 2]), 2]
    size = max(round(1.0 / motion.dt), 1)
    return float(np.abs(np.diff(yaw[::size])).sum())


def _unit(
    per_number: float,
    nominal: Geometry,
    known: bool,
    findings: list[KinematicFinding],
    settings: KinematicsSettings,
) -> SpeedUnit | None:
    """Unit of the speeds where they are not rad/s of the wheel; what is told of it is appended."""
    ratio = per_number / nominal.R
    most = settings.max_same_unit_ratio if known else settings.usual_radius_ratio**2
    if 1 / most < ratio < most:
        return None
    units = speed_units(per_number, nominal.R, known, settings)
    told = f"one number of velocity_* moves the robot {per_number:.4g} m a second"
    if not units:
        findings.append(
            KinematicFinding(
                "error",
                f"{told}: no unit and gear that is common makes a wheel's radius of it",
                "give the radius of the wheels by --geometry, or the unit by an import map",
            )
        )
        return None
    best, others = units[0], units[1:4]
    also = "; ".join(f"{one.name} (R = {one.radius:.4g} m)" for one in others)
    cure = f"multiply velocity_* by {1 / best.factor:.6g} to have rad/s of the wheels"
    if not known:
        cure += "; give your wheels' radius by --geometry to be sure"
    message = f"velocity_* look like {best.name}: {told}, so R = {best.radius:.4g} m"
    if also:
        message += f" (also possible: {also})"
    findings.append(KinematicFinding("warning", message, cure))
    return best


def _length_findings(
    parameters: dict[str, Length],
    nominal: Geometry,
    known: bool,
    turned: float,
    settings: KinematicsSettings,
) -> Iterator[KinematicFinding]:
    for name, wanted in (("R", nominal.R), ("L", nominal.L)):
        length = parameters[name]
        if length.value is None or length.std is None:
            yield KinematicFinding(
                "info",
                f"{name} is not shown: the platform turns by "
                f"{np.degrees(turned):.0f} degrees in all",
                "turn on the spot, a few turns each way",
            )
            continue
        far = abs(length.value / wanted - 1)
        if far > max(
            settings.min_scale_difference, settings.difference_deviations * length.std / wanted
        ):
            of = _of(known)
            reach = settings.interval_deviations * length.std
            yield KinematicFinding(
                "warning",
                f"{name} = {length.value:.5f} m by the pose (95 %: {length.value - reach:.5f} ... "
                f"{length.value + reach:.5f}), {wanted:g} m by {of}",
                "give the lengths found, which youbot kinematics -o FILE writes, by --geometry",
            )
    delay = parameters["delay"]
    assert delay.value is not None and delay.std is not None
    if abs(delay.value) > max(settings.min_delay, settings.difference_deviations * delay.std):
        side = "behind" if delay.value > 0 else "ahead of"
        yield KinematicFinding(
            "info", f"the speeds are {1e3 * abs(delay.value):.0f} ms {side} the pose"
        )
    yaw = parameters["frame_yaw"]
    assert yaw.value is not None and yaw.std is not None
    if abs(yaw.value) > max(settings.min_frame_yaw, settings.difference_deviations * yaw.std):
        degrees = np.degrees(yaw.value)
        level = "warning" if abs(yaw.value) > settings.doubtful_frame_yaw else "info"
        yield KinematicFinding(
            level,
            f"the robot's forward direction is {degrees:+.2f} degrees from the pose's",
            "turn the tracked body's frame, or the map's frame yaw, by that",
        )


def _wheel_findings(
    wheels: dict[str, WheelFit], nominal: Geometry, settings: KinematicsSettings
) -> Iterator[KinematicFinding]:
    if not wheels:
        return
    radii = np.array([wheel.radius[0] for wheel in wheels.values()])
    mean = float(radii.mean())
    for name, wheel in wheels.items():
        value, std = wheel.radius[0] / mean - 1, wheel.radius[1] / mean
        if abs(value) > max(settings.min_wheel_difference, settings.wheel_deviations * std):
            size = "larger" if value > 0 else "smaller"
            yield KinematicFinding(
                "warning",
                f"wheel {name} is {100 * abs(value):.2g} % {size} than the mean of the four "
                f"(+- {100 * std:.2g} %), or its encoder counts so",
                "measure it; the effect wheel_radius_error models it",
            )
        said = nominal.roller_angles[WHEELS.index(name)]
        if wheel.roller_angle and _roller_off(wheel, settings, said):
            angle, deviation = wheel.roller_angle
            yield KinematicFinding(
                "warning",
                f"the rollers of wheel {name} stand at {np.degrees(abs(angle)):.1f} degrees "
                f"(+- {np.degrees(deviation):.1f}), not {np.degrees(said):.3g}",
                "give it in the geometry (youbot kinematics -o FILE writes it), or use the effect "
                "roller_angle_error",
            )


def _counts(
    motions: Sequence[Motion], delay: float, factor: float, settings: KinematicsSettings
) -> float | None:
    """Numbers of position_* a turn of the wheel; None without them, or where they are rad."""
    ways, turns = [], []
    for motion in motions:
        if motion.position is None:
            continue
        size = max(round(settings.coarse_time / motion.dt), 1)
        ways.append(np.diff(motion.position[::size], axis=0).ravel())
        turns.append(np.diff(angles_at(motion, delay)[::size], axis=0).ravel() / factor)
    if not ways:
        return None
    way, turn = np.concatenate(ways), np.concatenate(turns)
    gain = float(way @ turn / max(float(turn @ turn), 1e-300))
    return None if abs(gain - 1) < settings.radian_tolerance else 2 * np.pi * gain


def _geometry(
    nominal: Geometry,
    parameters: dict[str, Length],
    wheels: dict[str, WheelFit],
    settings: KinematicsSettings,
) -> Geometry:
    """The nominal geometry with what was found; track and base keep their ratio."""
    radius, arm = parameters["R"].value, parameters["L"].value
    angles = [
        abs(wheel.roller_angle[0]) if wheel.roller_angle and _roller_off(wheel, settings, said)
        else said
        for wheel, said in zip(wheels.values(), nominal.roller_angles, strict=False)
    ]  # fmt: skip
    found = nominal
    if angles:
        found = replace(found, roller_angles=tuple(angles))
    if radius is not None:
        found = replace(found, R=radius)
    if arm is not None:
        longer = arm / found.L
        found = replace(found, l=nominal.l * longer, h=nominal.h * longer)
    return found


def _or_in(nominal: Geometry) -> str:
    """Where l > h the other arrangement turns the wheels the other way."""
    changed = other(nominal) if nominal.l > nominal.h else None
    return f', or the rollers stand in {changed.arrangement} ("arrangement")' if changed else ""


def _from_gyro(
    motions: Sequence[Motion], geometry: Geometry | None, settings: KinematicsSettings
) -> Kinematics:
    nominal = geometry or Geometry()
    theta, covariance, turned = fit_gyro([in_x(m, nominal) for m in motions], settings)
    g, delay = theta.tolist()
    std, delay_std = np.sqrt(np.diag(covariance)).tolist()
    shown = turned > settings.min_turning and std < settings.max_relative_std * abs(g) and g > 0
    none = Length(None, "m", None)
    findings = [
        KinematicFinding(
            "info",
            "R is not shown: a gyro tells R/L alone",
            "log a pose too (motion capture, odometry of a lidar)",
        )
    ]
    arm, ratio = none, Length(None, "", None)
    if shown:
        ratio = Length(g, "", std)
        arm = Length(nominal.R / g, "m", nominal.R / g * std / g)
        findings.append(
            KinematicFinding("info", f"L is with R = {nominal.R:g} m of the geometry taken as true")
        )
        wanted, reach = nominal.R / nominal.L, settings.interval_deviations * std
        if abs(g / wanted - 1) > max(
            settings.min_scale_difference, settings.difference_deviations * std / wanted
        ):
            findings.append(
                KinematicFinding(
                    "warning",
                    f"R/L = {g:.5f} by the gyro (95 %: {g - reach:.5f} ... "
                    f"{g + reach:.5f}), {wanted:.5f} by the geometry",
                    "measure wheels, track and wheelbase, or the gyro's scale",
                )
            )
    elif g <= 0 and turned > settings.min_turning:
        findings.append(
            KinematicFinding(
                "error", "gyro_z turns against the wheels",
                f"multiply it by -1, or exchange the left and right wheels{_or_in(nominal)}",
            )
        )  # fmt: skip
    else:
        findings.append(
            KinematicFinding(
                "info", f"R/L is not shown: the platform turns by {np.degrees(turned):.0f} degrees",
                "turn on the spot, a few turns each way",
            )
        )  # fmt: skip
    parameters = {
        "R": none,
        "L": arm,
        "delay": Length(delay, "s", delay_std) if shown else Length(None, "s", None),
        "frame_yaw": Length(None, "rad", None),
        "R_over_L": ratio,
    }
    slip = SlipFound(None, identity_share(motions), [])
    travelled = 0.0
    return Kinematics(
        parameters, slip, findings, travelled, turned, _geometry(nominal, parameters, {}, settings)
    )
