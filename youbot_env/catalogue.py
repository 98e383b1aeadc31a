"""The effects themselves: the four components of the base model, then what can be added to them.

To add an effect, write one function and register it; nothing else in the project changes.
"""

from __future__ import annotations

from youbot_env.effects import (
    ACTUATOR,
    BASE,
    BODY,
    CHANNEL,
    ROLLER,
    WHEEL,
    WORLD,
    Parameter,
    effect,
)

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

_PAPER = "Identification of the KUKA youBot's parameters, RFBR 16-01-00429-a"


@effect(
    registry=BASE,
    acts_at=BODY,
    parameters=[
        Parameter("m0", "kg", lower=0.0, size=35.0),
        Parameter("I0", "kg m^2", lower=0.0, size=4.0),
        Parameter("m_aX", "kg m", size=0.5),
        Parameter("m_aY", "kg m", size=0.5),
    ],
    source=f"Appell's equations; {_PAPER}",
    recognise="Part of the base model.",
)
def rigid_body(xp, body, m0, I0, m_aX, m_aY):  # noqa: N803
    """Planar rigid body with an eccentric centre of mass, about O in the body frame."""
    (vx, vy, wz), (ax, ay, alpha) = body.twist, body.acceleration
    return (
        m0 * (ax - wz * vy) - m_aY * alpha - m_aX * wz * wz,
        m0 * (ay + wz * vx) + m_aX * alpha - m_aY * wz * wz,
        I0 * alpha + m_aX * (ay + wz * vx) - m_aY * (ax - wz * vy),
    )


@effect(
    registry=BASE,
    acts_at=WHEEL,
    parameters=[Parameter("I1", "kg m^2", lower=0.0, size=0.006)],
    source=f"Appell's equations; {_PAPER}",
    recognise="Part of the base model.",
)
def wheel_inertia(xp, wheel, I1):  # noqa: N803
    """Spin inertia of a wheel and its drive [N m]: I1 phi''."""
    return I1 * wheel.acceleration


@effect(
    registry=BASE,
    acts_at=WHEEL,
    parameters=[Parameter("mu1", "N m s", lower=0.0, size=0.1)],
    source=_PAPER,
    recognise="Part of the base model.",
    dissipative=True,
)
def wheel_viscous_friction(xp, wheel, mu1):
    """Viscous friction of a wheel joint [N m]: mu1 phi'."""
    return mu1 * wheel.rate


@effect(
    registry=BASE,
    acts_at=ROLLER,
    parameters=[Parameter("mu2", "N m s", lower=0.0, size=0.005)],
    source=_PAPER,
    recognise="Part of the base model.",
    dissipative=True,
)
def roller_viscous_friction(xp, roller, mu2):
    """Viscous friction of a roller axle [N m]: mu2 gamma'."""
    return mu2 * roller.rate


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=5.0, size=0.25),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994",
    recognise="The residual is a step that changes its sign where a wheel reverses.",
    dissipative=True,
)
def wheel_coulomb_friction(xp, wheel, torque, smoothing):
    """Dry friction of each wheel joint [N m]: f_c tanh(phi'/eps)."""
    return torque * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter(
            "extra",
            "N m s",
            lower=0.0,
            upper=2.0,
            size=0.1,
            each_wheel=True,
            relative_to="least",
            absorbed_by="mu1",
        )
    ],
    source="Viscous friction as in the base model, one coefficient a wheel",
    recognise="The residual grows with the speed of one wheel alone: that wheel drags.",
    dissipative=True,
)
def uneven_wheel_friction(xp, wheel, extra):
    """Viscous friction of one wheel beyond that of the freest one [N m]: k_i phi_i'."""
    return extra * wheel.rate


@effect(
    acts_at=WORLD,
    parameters=[
        Parameter("tilt_x", "rad", lower=-0.3, upper=0.3, size=0.018),
        Parameter("tilt_y", "rad", lower=-0.3, upper=0.3, size=0.018),
    ],
    source="Weight on a plane inclined by small angles about both world axes",
    recognise="The residual is a constant force in the world: turned around, its sign flips.",
)
def floor_tilt(xp, world, tilt_x, tilt_y):
    """Weight along a floor that rises towards world +X, +Y [N]: m0 g sin(tilt) at the CoM."""
    weight = world.base.m0 * GRAVITY
    force_x, force_y = weight * xp.sin(tilt_x), weight * xp.sin(tilt_y)
    return force_x, force_y, world.com_x * force_y - world.com_y * force_x


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("share", "1", lower=0.0, upper=0.9, size=0.15),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Gear losses that grow with the transmitted torque: Linderoth et al., IROS 2013",
    recognise="Friction that grows when the robot accelerates or climbs, not only with speed.",
    dissipative=True,
)
def load_dependent_friction(xp, wheel, share, smoothing):
    """Gear friction in proportion to the transmitted torque [N m]: s |M| tanh(phi'/eps)."""
    return share * xp.abs(wheel.torque) * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=ACTUATOR,
    parameters=[Parameter("time_constant", "s", lower=0.0, upper=1.0, size=0.05)],
    source="First-order model of a drive's current loop",
    recognise="The residual follows the rate of the torque: the robot answers late.",
)
def actuator_lag(xp, drive, time_constant):
    """Command behind a drive that follows with a first-order lag [N m]: M + tau M'."""
    return drive.torque + time_constant * drive.torque_rate


@effect(
    acts_at=CHANNEL,
    parameters=[
        Parameter("gain", "1", lower=-0.9, upper=2.0, size=0.1, each_wheel=True, relative_to="mean")
    ],
    source="Spread of motor torque constants and current sensors",
    recognise="The residual follows the torque of one wheel: its torque is mis-scaled in the log.",
)
def torque_gain_error(xp, channel, gain):
    """True torque behind a mis-scaled channel [N m]: (1 + g_i) M_i."""
    return (1 + gain) * channel.torque


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=5.0, size=0.2),
        Parameter("breakaway", "N m", lower=0.0, upper=5.0, size=0.15),
        Parameter("stribeck_speed", "rad/s", default=0.5, lower=0.05, upper=5.0),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Stribeck curve: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994",
    recognise="As Coulomb friction, with an extra peak where a wheel hardly turns.",
    dissipative=True,
)
def wheel_stribeck_friction(xp, wheel, torque, breakaway, stribeck_speed, smoothing):
    """Dry friction with breakaway [N m]: (f_c + f_b exp(-(phi'/v_s)^2)) tanh(phi'/eps)."""
    peak = breakaway * xp.exp(-((wheel.rate / stribeck_speed) ** 2))
    return (torque + peak) * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=ROLLER,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=1.0, size=0.03),
        Parameter("smoothing", "rad/s", default=0.1, lower=1e-3, upper=5.0),
    ],
    source="Coulomb friction, at the rollers' bushings",
    recognise="A step in the residual where VY + W x_i reverses; none in driving straight ahead.",
    dissipative=True,
)
def roller_coulomb_friction(xp, roller, torque, smoothing):
    """Dry friction of each roller axle [N m]: f_c tanh(gamma'/eps)."""
    return torque * xp.tanh(roller.rate / smoothing)


@effect(
    acts_at=WHEEL,
    parameters=[Parameter("coefficient", "N m s^2", lower=0.0, upper=1.0, size=0.01)],
    source="Turbulent (churning) losses: quadratic in the speed",
    recognise="The residual bends upwards with the speed of the wheels.",
    dissipative=True,
)
def quadratic_friction(xp, wheel, coefficient):
    """Friction that grows with the square of a wheel's speed [N m]: k phi' |phi'|."""
    return coefficient * wheel.rate * xp.abs(wheel.rate)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("fraction", "1", lower=0.0, upper=10.0, size=0.5),
        Parameter("time_constant", "s", default=30.0, lower=2.0, upper=600.0),
    ],
    source="Grease that warms up: exponential approach to the warm friction",
    recognise="Friction that fades over the first minute of each log.",
    dissipative=True,
)
def friction_warmup(xp, wheel, fraction, time_constant):
    """Extra viscous friction of cold wheel joints [N m]: mu1 f exp(-t/T) phi'."""
    return wheel.base.mu1 * fraction * xp.exp(-wheel.time / time_constant) * wheel.rate


@effect(
    acts_at=ROLLER,
    parameters=[Parameter("inertia", "kg m^2", lower=0.0, upper=1e-2, size=1e-4)],
    source="Spin inertia of the rollers, which the base model neglects",
    recognise="Sideways and turning motion feel heavier than driving ahead.",
)
def roller_inertia(xp, roller, inertia):
    """Spin inertia of each roller on the floor [N m]: I_r gamma''."""
    return inertia * roller.acceleration
