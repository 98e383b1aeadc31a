"""The paper's calibration motions I to IV, and their sequence."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from youbot_env.errors import InputError, count, finite
from youbot_env.motions.base import Motion, MotionSequence, sequence
from youbot_env.motions.limits import MotionLimits
from youbot_env.motions.periodic import Circling, Straight, Turning
from youbot_env.physics.geometry import Geometry

# The default amplitudes and frequencies of motions I to IV keep the paper's platform below
# 11.5 rad/s and 2 N m on the ideal motion. Low frequencies serve the stock loop, which hardly
# follows above some 2 rad/s: what tells m0 from I1 is the product of speed and yaw rate.


def _rim_speed(name: str, geometry: Geometry, wheel_speed: float) -> float:
    """Speed [m/s] at the rim of a wheel, no faster than a platform's wheels may be driven."""
    speed = finite(f"motion '{name}' wheel_speed", wheel_speed)
    if geometry.speed_limit is not None:
        speed = min(speed, MotionLimits.of(geometry).wheel_speed)
    return geometry.R * speed


def motion_i(
    geometry: Geometry | None = None,
    *,
    wheel_speed: float = 11.0,
    frequency: float = 1.0,
    duration: float = 35.0,
) -> Turning:
    """Motion I: turning about the point of the Y axis at distance L, so VX = L W, VY = 0.

    The left wheels stand still. ``wheel_speed`` [rad/s] is the peak of the right ones,
    ``frequency`` [rad/s] that of W. Raises InputError if a number cannot be.
    """
    return _turning("I", geometry or Geometry(), wheel_speed, frequency, duration, (1.0, 0.0))


def motion_ii(
    geometry: Geometry | None = None,
    *,
    wheel_speed: float = 9.0,
    frequency: float = 1.6,
    duration: float = 35.0,
) -> Turning:
    """Motion II: turning about the point of the X axis at distance L, so VX = 0, VY = L W.

    The back wheels stand still. ``wheel_speed`` [rad/s] is the peak of the front ones,
    ``frequency`` [rad/s] that of W. Raises InputError if a number cannot be.
    """
    return _turning("II", geometry or Geometry(), wheel_speed, frequency, duration, (0.0, 1.0))


def _turning(
    name: str,
    geometry: Geometry,
    wheel_speed: float,
    frequency: float,
    duration: float,
    direction: tuple[float, float],
) -> Turning:
    """Turning about a point at distance L; ``direction`` is that of V per W in the body frame.

    Two wheels stand still there, and the other two run at twice L W / R.
    """
    rim_speed = _rim_speed(name, geometry, wheel_speed)
    lever_x, lever_y = (share * geometry.L for share in direction)
    return Turning(
        name=name,
        duration=duration,
        frequency=frequency,
        # The moving wheels roll at V + L W = 2 L W.
        yaw_rate=rim_speed / (2 * geometry.L),
        lever_x=lever_x,
        lever_y=lever_y,
    )


def motion_iii(
    geometry: Geometry | None = None,
    *,
    wheel_speed: float = 8.0,
    frequency: float = 2.4,
    duration: float = 35.0,
) -> Circling:
    """Motion III: translation along a circle, W = 0.

    ``wheel_speed`` [rad/s] is every wheel's peak, ``frequency`` [rad/s] the circle's angular
    rate. Raises InputError if a number cannot be.
    """
    geometry = geometry or Geometry()
    rim_speed = _rim_speed("III", geometry, wheel_speed)
    # A wheel rolls at |VX +- VY|, whose peak on a circle is sqrt(2) times the speed.
    return Circling(name="III", duration=duration, frequency=frequency, speed=rim_speed / 2**0.5)


def motion_iv(
    geometry: Geometry | None = None,
    *,
    wheel_speed: float = 10.8,
    yaw_share: float = 0.6,
    frequency: float = 1.3,
    duration: float = 35.0,
    legs: int = 2,
) -> MotionSequence:
    """Motion IV: O moves straight and uniformly in the world while the platform swings.

    The line runs along the heading at the start, there and back on ``legs`` legs of equal time,
    so that the run needs no long hall. ``wheel_speed`` [rad/s] bounds the wheels between the
    ramps, ``yaw_share`` is the part of it that turning takes, ``frequency`` [rad/s] that of W.
    Raises InputError if a number cannot be.
    """
    geometry = geometry or Geometry()
    rim_speed = _rim_speed("IV", geometry, wheel_speed)
    yaw_share = finite("motion 'IV' yaw_share", yaw_share)
    legs = count("motion 'IV' legs", legs)
    return sequence(
        [
            Straight(
                name=f"IV leg {leg + 1}",
                duration=finite("motion 'IV' duration", duration) / legs,
                frequency=frequency,
                # There and back. The rest of the wheels' speed is for turning.
                speed=(1 - yaw_share) * rim_speed * (-1) ** leg,
                direction=0.0,
                yaw_rate=yaw_share * rim_speed / geometry.L,
            )
            for leg in range(legs)
        ],
        name="IV",
    )


CALIBRATION: dict[str, Callable[[Geometry], Motion]] = {
    "I": motion_i,
    "II": motion_ii,
    "III": motion_iii,
    "IV": motion_iv,
}
"""The paper's motions by name, for a geometry."""


def calibration(
    geometry: Geometry | None = None, order: Sequence[str] = ("I", "III", "II", "IV")
) -> MotionSequence:
    """The paper's calibration run: motions I - III - II - IV of 35 s each.

    On the youBot the ideal run keeps O within 3.8 m by 0.4 m of floor, starts at one end of it
    and returns; it peaks at 11.5 rad/s, 0.27 m/s and, for the paper's parameters, 1.97 N m.

    Raises
    ------
    InputError
        If ``order`` is empty or names a motion that is none of I, II, III, IV.
    """
    for name in order:
        if name not in CALIBRATION:
            raise InputError(f"calibration motion: {name!r} is none of {', '.join(CALIBRATION)}")
    motions = [CALIBRATION[name](geometry or Geometry()) for name in order]
    return sequence(motions, name="calibration")
