"""The effects themselves: the four components of the base model, then what can be added to them.

To add an effect, write one function and register it; no other code changes.
"""

from __future__ import annotations

from math import atan2, hypot

from youbot_env.physics.effect import (
    ACTUATOR,
    BASE,
    BODY,
    CHANNEL,
    CLOCK,
    ROLLER,
    WHEEL,
    WORLD,
    Actuator,
    Body,
    Channel,
    Clock,
    Parameter,
    Public,
    Roller,
    Wheel,
    World,
    effect,
)
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.namespaces import Namespace, Number, Triple

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

MOST_TORQUE, MOST_FORCE, MOST_MASS = 1e3, 1e5, 1e5
"""Upper bounds [N m], [N], [kg]: beyond platforms of some tonnes. They keep a fit finite and say
nothing of a robot: the catalogue serves one of 5 kg as well as one of a tonne."""

_PAPER = "Identification of the KUKA youBot's parameters, RFBR 16-01-00429-a"


def _per(moment: float, strength: float) -> float:
    """moment / strength; 0 for strength 0, where the place is not defined (it must be finite)."""
    return moment / strength if strength else 0.0


def _centre_of_mass(
    geometry: Geometry,
    m0: float,
    I0: float,
    m_aX: float,
    m_aY: float,
) -> tuple[float, ...]:
    # The paper states aX, aY of the platform without its wheels; those lie symmetrically about O.
    mass = m0 - 4 * geometry.m1
    return m0, I0, _per(m_aX, mass), _per(m_aY, mass)


def _mass_moments(
    xp: Namespace,
    geometry: Geometry,
    m0: Number,
    I0: Number,
    aX: Number,
    aY: Number,
) -> tuple[Number, ...]:
    mass = m0 - 4 * geometry.m1
    return m0, I0, mass * aX, mass * aY


_MASS = Parameter("m0", "kg", lower=0.0, size=35.0)
_INERTIA = Parameter("I0", "kg m^2", lower=0.0, size=4.0)


@effect(
    registry=BASE,
    acts_at=BODY,
    parameters=[
        _MASS,
        _INERTIA,
        Parameter("m_aX", "kg m", size=0.5),
        Parameter("m_aY", "kg m", size=0.5),
    ],
    public=Public(
        parameters=(
            _MASS,
            _INERTIA,
            Parameter("aX", "m", size=0.02),
            Parameter("aY", "m", size=0.02),
        ),
        forward=_centre_of_mass,
        inverse=_mass_moments,
    ),
    source=f"Appell's equations; {_PAPER}",
    recognise="Part of the base model.",
)
def rigid_body(
    xp: Namespace, body: Body, m0: Number, I0: Number, m_aX: Number, m_aY: Number
) -> Triple:
    """Planar rigid body with an eccentric centre of mass, about O in the body frame."""
    (vx, vy, wz), (ax, ay, alpha) = body.twist, body.acceleration
    # ax, ay are derivatives of components in the turning frame; the acceleration of O is
    # (ax - wz vy, ay + wz vx).
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
def wheel_inertia(xp: Namespace, wheel: Wheel, I1: Number) -> Number:
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
def wheel_viscous_friction(xp: Namespace, wheel: Wheel, mu1: Number) -> Number:
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
def roller_viscous_friction(xp: Namespace, roller: Roller, mu2: Number) -> Number:
    """Viscous friction of a roller axle [N m]: mu2 gamma'."""
    return mu2 * roller.rate


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=MOST_TORQUE, size=0.25),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994",
    recognise="The residual is a step that changes its sign where a wheel reverses.",
    dissipative=True,
)
def wheel_coulomb_friction(
    xp: Namespace, wheel: Wheel, torque: Number, smoothing: Number
) -> Number:
    """Dry friction of each wheel joint [N m]: f_c tanh(phi'/eps)."""
    return torque * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter(
            "extra",
            "N m s",
            lower=0.0,
            upper=MOST_TORQUE,
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
def uneven_wheel_friction(xp: Namespace, wheel: Wheel, extra: Number) -> Number:
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
def floor_tilt(xp: Namespace, world: World, tilt_x: Number, tilt_y: Number) -> Triple:
    """Weight along a floor that rises towards world +X, +Y [N]: m0 g sin(tilt) at the CoM."""
    # The force that holds the platform on the slope: a wrench is what a motion demands, so uphill
    # is positive.
    weight = world.base.m0 * GRAVITY
    force_x, force_y = weight * xp.sin(tilt_x), weight * xp.sin(tilt_y)
    return force_x, force_y, world.com_x * force_y - world.com_y * force_x


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("share", "1", lower=0.0, upper=0.9, size=0.3),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Gear losses that grow with the transmitted torque: Linderoth et al., IROS 2013",
    recognise="Friction that grows when the robot accelerates or climbs, not only with speed.",
    dissipative=True,
)
def load_dependent_friction(
    xp: Namespace, wheel: Wheel, share: Number, smoothing: Number
) -> Number:
    """Gear friction in proportion to the transmitted torque [N m]: s |M| tanh(phi'/eps)."""
    # A share below 1 (upper bound 0.9) keeps the fixed point in ``acting_torque`` a contraction.
    return share * xp.abs(wheel.torque) * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=ACTUATOR,
    parameters=[Parameter("time_constant", "s", lower=0.0, upper=1.0, size=0.1)],
    source="First-order model of a drive's current loop",
    recognise="The residual follows the rate of the torque: the robot answers late.",
)
def actuator_lag(xp: Namespace, drive: Actuator, time_constant: Number) -> Number:
    """Command behind a drive that follows with a first-order lag [N m]: M + tau M'."""
    return drive.torque + time_constant * drive.torque_rate


STIFF = 1000.0
"""Natural frequency [rad/s] of a drive above which no log shows it."""


def _frequency_and_damping(geometry: object, first: float, second: float) -> tuple[float, ...]:
    frequency = STIFF if second <= 0 else min(second**-0.5, STIFF)
    return frequency, 0.5 * first * frequency


def _first_and_second(
    xp: Namespace, geometry: object, frequency: Number, damping: Number
) -> tuple[Number, ...]:
    return 2 * damping / frequency, frequency**-2


@effect(
    acts_at=ACTUATOR,
    parameters=[
        Parameter("first", "s", lower=0.0, upper=1.0, size=0.02),
        Parameter("second", "s^2", lower=STIFF**-2, upper=0.1, size=1e-3),
    ],
    public=Public(
        parameters=(
            Parameter("frequency", "rad/s", lower=3.0, upper=STIFF, size=30.0, without=STIFF),
            Parameter("damping", "1", lower=0.0, upper=500.0, size=0.3),
        ),
        forward=_frequency_and_damping,
        inverse=_first_and_second,
    ),
    source="Second-order model of a drive with an elastic gear or a current loop that overshoots",
    recognise="The robot swings after each step of torque, at one frequency.",
)
def drive_resonance(xp: Namespace, drive: Actuator, first: Number, second: Number) -> Number:
    """Command behind a drive of second order [N m]: M + 2 z M'/w + M''/w^2."""
    return drive.torque + first * drive.torque_rate + second * drive.torque_second_rate


@effect(
    acts_at=CHANNEL,
    parameters=[
        Parameter(
            "offset",
            "N m",
            lower=-MOST_TORQUE,
            upper=MOST_TORQUE,
            size=0.1,
            each_wheel=True,
            relative_to="internal",
        )
    ],
    source="Zero error of current sensors and their amplifiers",
    recognise="A constant residual in the body frame: the wheels seem to push at rest. As much at "
    "both front wheels as at both back ones with the other sign exerts no force: no log shows it.",
)
def torque_offset(xp: Namespace, channel: Channel, offset: Number) -> Number:
    """True torque behind a channel whose zero is off [N m]: M_i + o_i."""
    return channel.torque + offset


@effect(
    acts_at=CHANNEL,
    parameters=[
        Parameter("fraction", "1", lower=-1.0, upper=0.9, size=0.2),
        Parameter(
            "time_constant",
            "s",
            default=60.0,
            lower=5.0,
            upper=3600.0,
            grid=(15.0, 40.0, 100.0, 300.0),
        ),
        Parameter(
            "shared_clock", "1", default=1.0, lower=0.0, upper=1.0, grid=(1.0, 0.0), whole=True
        ),
    ],
    source="Magnets and windings that warm up: exponential approach to the warm torque constant",
    recognise="All torques do less and less over the session, in slow and fast motion alike.",
)
def torque_constant_drift(
    xp: Namespace,
    channel: Channel,
    fraction: Number,
    time_constant: Number,
    shared_clock: Number,
) -> Number:
    """True torque of a motor that warms up [N m]: (1 - f (1 - exp(-t/T))) M.

    t counts from the start of the clock that the logs share, or with ``shared_clock`` 0 from the
    start of each log.
    """
    time = channel.time + shared_clock * channel.start
    return (1 - fraction * (1 - xp.exp(-time / time_constant))) * channel.torque


def _within(xp: Namespace, torque: Number, limit: Number) -> Number:
    """A torque clipped at both limits; odd in the limit, so that it has a slope at zero too."""
    return 0.5 * (xp.abs(torque + limit) - xp.abs(torque - limit))


def _saturated(xp: Namespace, channel: Channel, limit: Number) -> Number:
    return _within(xp, channel.torque, limit)


@effect(
    acts_at=CHANNEL,
    parameters=[
        Parameter(
            "limit",
            "N m",
            lower=1e-3,
            upper=MOST_TORQUE,
            size=1.0,
            without=MOST_TORQUE,
            grid=(0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85),
            of_peak=True,
        )
    ],
    source="Current limit of a drive that the command or its log does not know",
    recognise="The residual is there at the largest torques only, and takes from them.",
    # Nothing beyond the limit can be had: the limit is the nearest.
    inverse=_saturated,
)
def torque_saturation(xp: Namespace, channel: Channel, limit: Number) -> Number:
    """True torque of a drive with a limit [N m]: M clipped at -M_max and M_max."""
    return _saturated(xp, channel, limit)


def _beyond_zone(xp: Namespace, channel: Channel, width: Number) -> Number:
    return channel.torque + width * xp.sign(channel.torque)


@effect(
    acts_at=CHANNEL,
    parameters=[Parameter("width", "N m", lower=0.0, upper=MOST_TORQUE, size=0.1)],
    source="Dead time of bridges and stiction of gears: no torque below a threshold",
    recognise="Torques below a threshold do nothing, larger ones act by as much less.",
    inverse=_beyond_zone,
)
def dead_zone(xp: Namespace, channel: Channel, width: Number) -> Number:
    """True torque of a drive with a dead zone [N m]: M less M clipped at -w and w."""
    return channel.torque - _within(xp, channel.torque, width)


LOSS_SPEED = 10.0
"""Wheel speed [rad/s] at which the loss of a speed-dependent gain is stated."""


@effect(
    acts_at=CHANNEL,
    # The bound keeps the true torque's sign up to twice the speed at which the loss is stated.
    parameters=[Parameter("loss", "1", lower=0.0, upper=0.45, size=0.2)],
    source="Back EMF that a drive of limited voltage does not make up for",
    recognise="The torque falls short in proportion to the speed of the wheels.",
)
def speed_dependent_gain(xp: Namespace, channel: Channel, loss: Number) -> Number:
    """True torque of a drive that weakens with speed [N m]: (1 - s |phi'|/(10 rad/s)) M."""
    # Never without any torque: a command could then not be found.
    left = xp.maximum(1 - loss * xp.abs(channel.rate) / LOSS_SPEED, 0.05)
    return left * channel.torque


@effect(
    acts_at=CHANNEL,
    parameters=[
        Parameter("gain", "1", lower=-0.9, upper=2.0, size=0.2, each_wheel=True, relative_to="mean")
    ],
    source="Spread of motor torque constants and current sensors",
    recognise="The residual follows the torque of one wheel: its torque is mis-scaled in the log.",
)
def torque_gain_error(xp: Namespace, channel: Channel, gain: Number) -> Number:
    """True torque behind a mis-scaled channel [N m]: (1 + g_i) M_i."""
    return (1 + gain) * channel.torque


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=MOST_TORQUE, size=0.2),
        Parameter("breakaway", "N m", lower=0.0, upper=MOST_TORQUE, size=0.15),
        Parameter(
            "stribeck_speed", "rad/s", default=0.5, lower=0.15, upper=5.0, grid=(0.2, 0.5, 1.2, 3.0)
        ),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Stribeck curve: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994",
    recognise="As Coulomb friction, with an extra peak where a wheel hardly turns.",
    dissipative=True,
)
def wheel_stribeck_friction(
    xp: Namespace,
    wheel: Wheel,
    torque: Number,
    breakaway: Number,
    stribeck_speed: Number,
    smoothing: Number,
) -> Number:
    """Dry friction with breakaway [N m]: (f_c + f_b exp(-(phi'/v_s)^2)) tanh(phi'/eps)."""
    peak = breakaway * xp.exp(-((wheel.rate / stribeck_speed) ** 2))
    return (torque + peak) * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=ROLLER,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=MOST_TORQUE, size=0.03),
        Parameter("smoothing", "rad/s", default=0.1, lower=1e-3, upper=5.0),
    ],
    source="Coulomb friction, at the rollers' bushings",
    recognise="A step in the residual where VY + W x_i reverses; none in driving straight ahead.",
    dissipative=True,
)
def roller_coulomb_friction(
    xp: Namespace, roller: Roller, torque: Number, smoothing: Number
) -> Number:
    """Dry friction of each roller axle [N m]: f_c tanh(gamma'/eps)."""
    return torque * xp.tanh(roller.rate / smoothing)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("extra", "N m", lower=0.0, upper=MOST_TORQUE, size=0.25, each_wheel=True),
        Parameter("smoothing", "rad/s", default=0.03, lower=1e-3, upper=1.0),
    ],
    source="Coulomb friction, one size a wheel joint: a bearing or brake that rubs",
    recognise="The residual is a step that changes its sign where one certain wheel reverses.",
    dissipative=True,
)
def uneven_coulomb_friction(
    xp: Namespace, wheel: Wheel, extra: Number, smoothing: Number
) -> Number:
    """Dry friction of one wheel joint beyond that of the freest [N m]: f_i tanh(phi_i'/eps)."""
    return extra * xp.tanh(wheel.rate / smoothing)


@effect(
    acts_at=ROLLER,
    parameters=[
        Parameter("extra", "N m", lower=0.0, upper=MOST_TORQUE, size=0.05, each_wheel=True),
        Parameter("smoothing", "rad/s", default=0.1, lower=1e-3, upper=5.0),
    ],
    source="Coulomb friction at the rollers' bushings, one size a wheel",
    recognise="A step in the residual where the rollers of the front, or back, wheels reverse.",
    dissipative=True,
)
def uneven_roller_friction(
    xp: Namespace, roller: Roller, extra: Number, smoothing: Number
) -> Number:
    """Dry friction at one wheel's roller beyond that of the freest [N m]: f_i tanh(gamma_i'/eps)"""
    return extra * xp.tanh(roller.rate / smoothing)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("coulomb", "N m", lower=-MOST_TORQUE, upper=MOST_TORQUE, size=0.1),
        Parameter("viscous", "N m s", lower=-MOST_TORQUE, upper=MOST_TORQUE, size=0.03),
        # Wider than that of friction of one sign: noise of 0.01 rad/s on a wheel at rest would be
        # a mean of 0.26 of |tanh(w/0.03)|, and of 0.08 here.
        Parameter("smoothing", "rad/s", default=0.1, lower=1e-3, upper=1.0),
    ],
    source="Friction that depends on the direction: Armstrong-Helouvry et al., Automatica 30(7)",
    recognise="The residual has one sign whichever way the wheels turn, and is gone at rest.",
)
def asymmetric_friction(
    xp: Namespace, wheel: Wheel, coulomb: Number, viscous: Number, smoothing: Number
) -> Number:
    """Friction that is larger forwards [N m]: f |tanh(phi'/eps)| + k |phi'|."""
    return coulomb * xp.abs(xp.tanh(wheel.rate / smoothing)) + viscous * xp.abs(wheel.rate)


@effect(
    acts_at=BODY,
    parameters=[
        Parameter("torque", "N m", lower=0.0, upper=MOST_FORCE, size=2.0),
        Parameter("smoothing", "rad/s", default=0.02, lower=1e-4, upper=1.0),
    ],
    source="Coulomb friction of contact patches that scrub as the platform turns",
    recognise="A step in the residual moment where the yaw rate reverses; none in straight motion.",
    dissipative=True,
)
def yaw_scrub(xp: Namespace, body: Body, torque: Number, smoothing: Number) -> Triple:
    """Dry torque against the yaw rate [N m]: M_s tanh(W/eps)."""
    return 0.0, 0.0, torque * xp.tanh(body.twist[2] / smoothing)


@effect(
    acts_at=BODY,
    parameters=[
        Parameter("force", "N", lower=0.0, upper=MOST_FORCE, size=8.0),
        Parameter("smoothing", "m/s", default=0.005, lower=1e-4, upper=0.1),
    ],
    source="Dry friction of a cable that is dragged along",
    recognise="A force of constant size against the velocity, whichever way the robot drives.",
    dissipative=True,
)
def cable_drag(xp: Namespace, body: Body, force: Number, smoothing: Number) -> Triple:
    """Dry force against the velocity of O [N]: f v / sqrt(|v|^2 + eps^2)."""
    vx, vy, _ = body.twist
    pull = force / xp.sqrt(vx**2 + vy**2 + smoothing**2)
    return pull * vx, pull * vy, 0.0


@effect(
    acts_at=WHEEL,
    parameters=[Parameter("coefficient", "N m s^2", lower=0.0, upper=MOST_TORQUE, size=0.01)],
    source="Turbulent (churning) losses: quadratic in the speed",
    recognise="The residual bends upwards with the speed of the wheels.",
    dissipative=True,
)
def quadratic_friction(xp: Namespace, wheel: Wheel, coefficient: Number) -> Number:
    """Friction that grows with the square of a wheel's speed [N m]: k phi' |phi'|."""
    return coefficient * wheel.rate * xp.abs(wheel.rate)


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("fraction", "1", lower=0.0, upper=10.0, size=0.5),
        Parameter(
            "time_constant",
            "s",
            default=30.0,
            lower=2.0,
            upper=600.0,
            grid=(6.0, 15.0, 40.0, 100.0),
        ),
        Parameter(
            "shared_clock", "1", default=0.0, lower=0.0, upper=1.0, grid=(0.0, 1.0), whole=True
        ),
    ],
    source="Grease that warms up: exponential approach to the warm friction",
    recognise="Friction that fades over the first minute of each log, or of the session.",
    dissipative=True,
)
def friction_warmup(
    xp: Namespace, wheel: Wheel, fraction: Number, time_constant: Number, shared_clock: Number
) -> Number:
    """Extra viscous friction of cold wheel joints [N m]: mu1 f exp(-t/T) phi'.

    t counts from the start of each log, or with ``shared_clock`` 1 from that of the clock that
    the logs share.
    """
    time = wheel.time + shared_clock * wheel.start
    return wheel.base.mu1 * fraction * xp.exp(-time / time_constant) * wheel.rate


@effect(
    acts_at=ROLLER,
    parameters=[Parameter("inertia", "kg m^2", lower=0.0, upper=10.0, size=1e-3)],
    source="Spin inertia of the rollers, which the base model neglects",
    recognise="Sideways and turning motion feel heavier than driving ahead.",
)
def roller_inertia(xp: Namespace, roller: Roller, inertia: Number) -> Number:
    """Spin inertia of each roller on the floor [N m]: I_r gamma''."""
    return inertia * roller.acceleration


_CYCLES = Parameter(
    "cycles",
    "1",
    default=12.0,
    lower=1.0,
    upper=40.0,
    grid=tuple(float(n) for n in range(1, 41)),
    whole=True,
)


def _amplitudes_and_phases(geometry: object, *values: float) -> tuple[float, ...]:
    sine, cosine, cycles = values[:4], values[4:8], values[8]
    sizes = [hypot(*pair) for pair in zip(sine, cosine, strict=True)]
    amplitude = sum(sizes) / len(sizes)
    shares = [size / amplitude if amplitude else 1.0 for size in sizes]
    phases = [atan2(c, s) for s, c in zip(sine, cosine, strict=True)]
    return amplitude, *phases, *shares, cycles


def _sines_and_cosines(
    xp: Namespace, geometry: object, amplitude: Number, *values: Number
) -> tuple[Number, ...]:
    phases, shares, cycles = values[:4], values[4:8], values[8]
    rows = list(zip(phases, shares, strict=True))
    sine = [amplitude * share * xp.cos(phase) for phase, share in rows]
    cosine = [amplitude * share * xp.sin(phase) for phase, share in rows]
    return *sine, *cosine, cycles


@effect(
    acts_at=WHEEL,
    parameters=[
        Parameter("sine", "N m", size=0.2, each_wheel=True),
        Parameter("cosine", "N m", size=0.2, each_wheel=True),
        _CYCLES,
    ],
    public=Public(
        parameters=(
            Parameter("amplitude", "N m", lower=0.0, upper=MOST_TORQUE, size=0.2),
            Parameter("phase", "rad", lower=-6.3, upper=6.3, size=0.5, each_wheel=True),
            # Of a wheel's amplitude in the mean one.
            Parameter("share", "1", default=1.0, lower=0.0, upper=4.0, each_wheel=True),
            _CYCLES,
        ),
        forward=_amplitudes_and_phases,
        inverse=_sines_and_cosines,
    ),
    source="Cogging and gear errors: Holtz, Springob, IEEE Trans. Ind. Electron. 43(2), 1996",
    recognise="The residual swings with the angle of each wheel, faster the faster it turns.",
)
def torque_ripple(
    xp: Namespace, wheel: Wheel, sine: Number, cosine: Number, cycles: Number
) -> Number:
    """Periodic resistance of each wheel [N m]: a_i sin(n phi_i + p_i) = a_i cos p_i sin(n phi_i)
    + a_i sin p_i cos(n phi_i)."""
    return sine * xp.sin(cycles * wheel.angle) + cosine * xp.cos(cycles * wheel.angle)


def _anchor(geometry: object, stiffness: float, pull_x: float, pull_y: float) -> tuple[float, ...]:
    return stiffness, _per(pull_x, stiffness), _per(pull_y, stiffness)


def _pull(
    xp: Namespace, geometry: object, stiffness: Number, anchor_x: Number, anchor_y: Number
) -> tuple[Number, ...]:
    return stiffness, stiffness * anchor_x, stiffness * anchor_y


@effect(
    acts_at=WORLD,
    parameters=[
        # Not down to zero, so that a constant pull can still be stated as that of a far anchor.
        Parameter("stiffness", "N/m", lower=1e-3, upper=MOST_FORCE, size=5.0),
        Parameter("pull_x", "N", size=5.0),
        Parameter("pull_y", "N", size=5.0),
    ],
    public=Public(
        parameters=(
            Parameter("stiffness", "N/m", lower=0.0, upper=MOST_FORCE, size=5.0),
            Parameter("anchor_x", "m", size=1.0),
            Parameter("anchor_y", "m", size=1.0),
        ),
        forward=_anchor,
        inverse=_pull,
    ),
    source="Hooke's law: a cable or hose that pulls O towards a point of the world",
    recognise="A force in the world that grows with the distance from one point of the floor.",
)
def tether(
    xp: Namespace, world: World, stiffness: Number, pull_x: Number, pull_y: Number
) -> Triple:
    """Force against a spring from O to an anchor [N]: k (x - x_A), k (y - y_A)."""
    return stiffness * world.x - pull_x, stiffness * world.y - pull_y, 0.0


def _neutral(geometry: object, stiffness: float, moment: float) -> tuple[float, ...]:
    return stiffness, _per(moment, stiffness)


def _twist_moment(
    xp: Namespace, geometry: object, stiffness: Number, neutral: Number
) -> tuple[Number, ...]:
    return stiffness, stiffness * neutral


@effect(
    acts_at=WORLD,
    parameters=[
        Parameter("stiffness", "N m/rad", lower=1e-3, upper=MOST_FORCE, size=0.6),
        Parameter("moment", "N m", size=0.6),
    ],
    public=Public(
        parameters=(
            Parameter("stiffness", "N m/rad", lower=0.0, upper=MOST_FORCE, size=0.6),
            Parameter("neutral", "rad", size=1.0),
        ),
        forward=_neutral,
        inverse=_twist_moment,
    ),
    source="Hooke's law: a cable from above that winds up as the platform turns",
    recognise="A moment that grows with the angle by which the robot has turned.",
)
def cable_twist(xp: Namespace, world: World, stiffness: Number, moment: Number) -> Triple:
    """Moment against a torsion spring [N m]: k (psi - psi_0)."""
    return 0.0, 0.0, stiffness * world.yaw - moment


LIGHTEST = 0.01
"""Smallest mass [kg] by which the moments of a payload are divided. Without it, a mass near zero
with moments from noise would be a mass far outside the platform."""

_TIME = Parameter(
    "time",
    "s",
    default=30.0,
    lower=0.0,
    grid=tuple(float(t) for t in range(5, 125, 5)),
    instant=True,
)


def _payload(
    xp: Namespace, time: Number, mass: Number, mass_x: Number, mass_y: Number, start: Number
) -> tuple[Number, Number, Number, Number]:
    """What a payload adds to m0, I0, m aX, m aY once it is on."""
    # 0 * time gives both values the type of ``time``: torch.where of two plain numbers would give
    # single precision.
    is_on = xp.where(time >= start, 1.0 + 0.0 * time, 0.0 * time)
    # A point mass: m (x^2 + y^2) = ((m x)^2 + (m y)^2) / m.
    inertia = (mass_x**2 + mass_y**2) / xp.maximum(mass, LIGHTEST)
    return is_on * mass, is_on * inertia, is_on * mass_x, is_on * mass_y


def _payload_place(
    geometry: object, mass: float, mass_x: float, mass_y: float, time: float
) -> tuple[float, ...]:
    return mass, _per(mass_x, mass), _per(mass_y, mass), time


def _payload_moments(
    xp: Namespace, geometry: object, mass: Number, x: Number, y: Number, time: Number
) -> tuple[Number, ...]:
    return mass, mass * x, mass * y, time


@effect(
    acts_at=BODY,
    parameters=[
        Parameter("mass", "kg", lower=LIGHTEST, upper=MOST_MASS, size=20.0),
        Parameter("mass_x", "kg m", size=0.5),
        Parameter("mass_y", "kg m", size=0.5),
        _TIME,
    ],
    public=Public(
        parameters=(
            Parameter("mass", "kg", lower=0.0, upper=MOST_MASS, size=20.0),
            Parameter("x", "m", size=0.1),
            Parameter("y", "m", size=0.1),
            _TIME,
        ),
        forward=_payload_place,
        inverse=_payload_moments,
    ),
    source="Rigid body dynamics: a point mass on the platform, from one moment on",
    recognise="From one moment of the log on the platform is heavier, or its mass lies elsewhere.",
    carries=_payload,
)
def payload_change(
    xp: Namespace, body: Body, mass: Number, mass_x: Number, mass_y: Number, time: Number
) -> Triple:
    """Wrench of a point mass at (x, y) that was put on at ``time``: m (a + ...), as the body's."""
    return rigid_body(xp, body, *_payload(xp, body.time, mass, mass_x, mass_y, time))


@effect(
    acts_at=CLOCK,
    parameters=[Parameter("delay", "s", lower=-0.2, upper=0.5, size=0.1)],
    source="Communication and computation between torque command, drive and log",
    recognise="The speeds answer late, by a time that is the same for slow and fast motion.",
)
def torque_delay(xp: Namespace, clock: Clock, delay: Number) -> Number:
    """Time [s] by which the true torque follows the logged one: M_true(t) = M(t - d)."""
    return delay
