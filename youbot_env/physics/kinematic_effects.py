"""Effects of kinematics: how the wheels roll, and how their speeds come into the log.

They demand no force. A model that holds one maps twist and wheel rates, force and wheel torques by
the wheels as they are, and takes logged speeds for what they are.
"""

from __future__ import annotations

from typing import cast

from youbot_env.physics.effect import (
    CONTACT,
    SPEED,
    Contact,
    Parameter,
    SpeedChannel,
    effect,
)
from youbot_env.physics.namespaces import Namespace, Number, Triple


@effect(
    acts_at=CONTACT,
    parameters=[
        Parameter(
            "error", "1", lower=-0.5, upper=1.0, size=0.03, each_wheel=True, relative_to="mean"
        )
    ],
    source="Borenstein, Feng, IEEE Trans. Robotics and Automation 12(6), 1996: unequal wheels",
    recognise="phi_1' + phi_2' - phi_3' - phi_4' follows the speed of one wheel, and so does the "
    "force that its torque exerts.",
)
def wheel_radius_error(xp: Namespace, contact: Contact, error: Number) -> Triple:
    """A wheel of another radius R (1 + e_i): it turns less for the same way, and pushes less."""
    turns = 1.0 / (1.0 + error)
    # Its rollers slide sideways as those of the other wheels do.
    return turns, turns, 1.0


@effect(
    acts_at=CONTACT,
    parameters=[
        Parameter("error", "rad", lower=-0.5, upper=0.5, size=0.035, each_wheel=True),
    ],
    source="No slip along the roller's axis, at an angle d to X: R phi' = u + v tan(d)",
    recognise="Driving sideways the platform feels lighter or heavier than ahead; a pose shows "
    "another way sideways than the wheels.",
)
def roller_angle_error(xp: Namespace, contact: Contact, error: Number) -> Triple:
    """Rollers at 45 degrees + e_i to X instead of 45, on each wheel to its own side.

    Where the geometry says another angle than 45 degrees, at that angle + e_i.
    """
    c, s, t = xp.cos(error), xp.sin(error), abs(cast(float, contact.tangent))
    steeper = t * s
    # tan(d + e) over tan(d) on the speed sideways; the roller's rate is that speed over r cos(d).
    return 1.0, (c + s / t) / (c - steeper), 1.0 / (c - steeper)


@effect(
    acts_at=SPEED,
    parameters=[
        Parameter(
            "gain", "1", lower=-0.9, upper=2.0, size=0.03, each_wheel=True, relative_to="mean"
        )
    ],
    source="Spread of encoder counts and gear ratios: a channel's scale",
    recognise="phi_1' + phi_2' - phi_3' - phi_4' follows the speed of one wheel, though forces do "
    "not: its speed is mis-scaled in the log.",
)
def speed_gain_error(xp: Namespace, channel: SpeedChannel, gain: Number) -> Number:
    """True rate of a wheel behind a mis-scaled speed [rad/s]: (1 + g_i) phi_i'."""
    return (1.0 + gain) * channel.speed


@effect(
    acts_at=SPEED,
    parameters=[Parameter("time_constant", "s", lower=0.0, upper=1.0, size=0.05)],
    source="First-order low-pass of a driver's or a filter's speed estimate",
    recognise="As a drive that lags: the speeds answer late. Where a pose is logged, they are late "
    "beside it.",
)
def speed_filter(xp: Namespace, channel: SpeedChannel, time_constant: Number) -> Number:
    """True rate behind a speed that is low-passed in the log [rad/s]: w + T w'."""
    return channel.speed + time_constant * channel.speed_rate


@effect(
    acts_at=SPEED,
    parameters=[Parameter("slip", "rad/s/(N m)", lower=0.0, upper=5.0, size=0.1)],
    source="Linear creep: Pacejka, Tire and Vehicle Dynamics, 2012, at small slip",
    recognise="phi_1' + phi_2' - phi_3' - phi_4' follows M_1 + M_2 - M_3 - M_4; a pose shows less "
    "way than the wheels when they push.",
)
def wheel_creep(xp: Namespace, channel: SpeedChannel, slip: Number) -> Number:
    """Rate at which a wheel rolls that turns faster by its torque [rad/s]: w - s M."""
    return channel.speed - slip * channel.torque
