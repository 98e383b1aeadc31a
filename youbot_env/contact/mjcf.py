"""The platform as MuJoCo sees it: free bodies, hinges, and ellipsoidal rollers on a plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from youbot_env.contact.settings import Contact, EngineSettings
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics.catalogue import GRAVITY
from youbot_env.physics.geometry import SIGN_X, SIGN_Y, WHEELS, Geometry

TRANSLATED = (
    *("floor_tilt", "wheel_coulomb_friction", "uneven_wheel_friction", "payload_change"),
    *("actuator_lag", "torque_delay"),
)
"""Effects of a model that the contact plant knows how to build."""

Array = NDArray[np.float64]


def roller_half_length(geometry: Geometry, rollers: int, slant: float = 2**0.5) -> float:
    """Half axis [m] of the ellipsoids of radius r whose envelope is nearly the circle of radius R.

    Turned by an angle a from the floor, a roller of half axis c holds the wheel's centre at the
    height (R - r) cos a + sqrt(r^2 + k sin^2 a), k = (c^2 - r^2) / 2. With k = r (R - r) the height
    is R up to fourth order in a, but it drops at the hand-over a = pi / rollers with a bump.
    With the second k below it is R again at the hand-over, but two rollers touch the floor for
    long. The mean of both is taken: with sixteen rollers of the youBot the height ripples by 10
    micrometres.
    """
    R, r, edge = geometry.R, geometry.r, math.pi / rollers
    smooth = r * (R - r)
    level = ((R - (R - r) * math.cos(edge)) ** 2 - r**2) / math.sin(edge) ** 2
    # c^2 = r^2 + 2 k, with k the mean of the two.
    # Of the roller at an angle d to X cos^2(d) of c^2 - r^2 counts, half at 45 degrees.
    return math.sqrt(r**2 + 0.5 * slant**2 * (smooth + level))


def profile(geometry: Geometry, rollers: int, angle: Array) -> Array:
    """Height (...) [m] of a wheel's centre above the floor at wheel angles (...) [rad]."""
    pitch = 2 * math.pi / rollers
    turned = (np.asarray(angle) + 0.5 * pitch) % pitch - 0.5 * pitch
    k = 0.5 * (roller_half_length(geometry, rollers) ** 2 - geometry.r**2)
    rise = np.sqrt(geometry.r**2 + k * np.sin(turned) ** 2)
    return (geometry.R - geometry.r) * np.cos(turned) + rise


@dataclass(frozen=True)
class Wheel:
    """How a wheel's mass m1 and spin inertia I1 are shared out [kg, kg m^2]."""

    hub: float
    roller: float
    hub_spin: float
    hub_across: float
    armature: float

    @staticmethod
    def of(model: Model, rollers: int) -> Wheel:
        """Hub and rollers weigh m1; what they lack in spin inertia is the drive's rotor.

        Raises
        ------
        InputError
            If m1 or I1 is too small for a wheel that exists.
        """
        g, spin = model.geometry, model.values["I1"]
        if g.m1 <= 0.0:
            raise InputError(f"model {model.name}: a plant with contacts needs wheels with m1 > 0")
        # The rollers' centres lie on a circle of radius R - r.
        ring = EngineSettings.roller_mass_share * g.m1 * (g.R - g.r) ** 2
        if spin < 2.0 * ring:
            raise InputError(
                f"model {model.name}: I1 = {spin:g} kg m^2 is too small for a plant with contacts, "
                f"at least {2.0 * ring:.2g}"
            )
        hub = (1.0 - EngineSettings.roller_mass_share) * g.m1
        # A solid disc, but no more than half of what is left: the rest is the rotor's, which is an
        # armature and adds nothing to the platform's yaw inertia.
        hub_spin = min(0.5 * hub * g.R**2, 0.5 * (spin - ring))
        return Wheel(
            hub,
            EngineSettings.roller_mass_share * g.m1 / rollers,
            hub_spin,
            0.6 * hub_spin,  # about a diameter: a flat disc would have 0.5, a thick one has more
            spin - ring - hub_spin,
        )


def platform_inertia(
    model: Model, wheel: Wheel, com_height: float, *, loaded: bool
) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it of all but the wheels.

    Together with the wheels they are m0, I0, aX, aY of the model, payload included if ``loaded``.
    Roll and pitch inertia, of which the model knows nothing, are a flat body's.
    """
    v, g = model.values, model.geometry
    mass = v["m0"] - 4 * g.m1
    # A thin ring about its diameter: half of the value about its axis.
    ring = 0.5 * (g.m1 - wheel.hub) * (g.R - g.r) ** 2
    of_wheels = 4 * (g.m1 * (g.h**2 + g.l**2) + wheel.hub_across + ring)
    # I0 is about O and includes the wheels; a body's inertia is about its own centre of mass.
    yaw = v["I0"] - of_wheels - mass * (v["aX"] ** 2 + v["aY"] ** 2)
    if yaw <= 0.0:
        raise InputError(
            f"model {model.name}: I0 = {v['I0']:g} kg m^2 is less than the wheels' mass and the "
            "platform's off-centre mass alone make; a body like that cannot be built"
        )
    # Heights are relative to O, which lies R above the floor.
    centre = np.array([v["aX"], v["aY"], com_height - g.R])
    inertia = np.diag([0.55 * yaw, 0.55 * yaw, yaw])
    if not loaded:
        return mass, centre, inertia
    load = v["payload_change.mass"]
    place = np.array(
        [v["payload_change.x"], v["payload_change.y"], EngineSettings.payload_height - g.R]
    )
    # Two masses about their common centre: the reduced mass times the distance squared.
    apart, reduced = place - centre, mass * load / (mass + load)
    inertia = inertia + reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return mass + load, (mass * centre + load * place) / (mass + load), inertia


def gravity(model: Model) -> Array:
    """Weight per mass (3,) [m/s^2] in the frame of a floor with the model's slope."""
    down = [-math.sin(model.values.get(f"floor_tilt.tilt_{axis}", 0.0)) for axis in "xy"]
    # The third component completes a unit vector: tilting does not change the weight.
    return GRAVITY * np.array([*down, -math.sqrt(1.0 - down[0] ** 2 - down[1] ** 2)])


def mjcf(model: Model, contact: Contact, *, loaded: bool = False) -> str:
    """The MJCF document of one platform at the origin.

    Parameters
    ----------
    model : its parameters, and of its effects floor_tilt, wheel_coulomb_friction,
        uneven_wheel_friction
    loaded : whether the effect payload_change's load is on it

    Raises
    ------
    InputError
        If no bodies have these parameters.
    """
    wheel = Wheel.of(model, contact.rollers)
    # Joint damping must be explicit: the implicit integrators add it after the contacts are solved
    # for, and with rollers as light as these that gives away a tenth of the contact forces.
    return f"""
<mujoco model="platform">
  <compiler angle="radian"/>
  <option timestep="{contact.timestep!r}" integrator="Euler" cone="elliptic"
      impratio="{EngineSettings.friction_stiffness_ratio!r}" gravity="{_numbers(gravity(model))}">
    <flag eulerdamp="disable"/>
  </option>
  <default>
    <geom type="ellipsoid" condim="3" friction="{contact.friction!r} 0 0"
        solref="{EngineSettings.contact_time!r} 1" contype="0" conaffinity="1" mass="0"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="1" conaffinity="0"/>
    <body name="platform" pos="0 0 {model.geometry.R!r}">
      <freejoint/>
      {_platform_inertial(model, wheel, contact, loaded)}
      {"".join(_wheel(model, contact, wheel, index) for index in range(4))}
    </body>
  </worldbody>
  <actuator>{"".join(f'<motor joint="{name}"/>' for name in WHEELS)}</actuator>
</mujoco>"""


def _numbers(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _platform_inertial(model: Model, wheel: Wheel, contact: Contact, loaded: bool) -> str:
    mass, centre, inertia = platform_inertia(model, wheel, contact.com_height, loaded=loaded)
    _check_stands(model, mass, centre)
    tensor = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])
    return f'<inertial mass="{mass!r}" pos="{_numbers(centre)}" fullinertia="{_numbers(tensor)}"/>'


def _check_stands(model: Model, mass: float, centre: Array) -> None:
    """InputError unless the weight passes between the wheels, whatever way the platform faces."""
    g, (slope_x, slope_y, down) = model.geometry, gravity(model)
    share = mass / (mass + 4 * g.m1)
    # The height of the common centre of mass times the slope: how far the weight's line moves.
    lean = (g.R + share * centre[2]) * math.hypot(slope_x, slope_y) / -down
    if np.any(share * np.abs(centre[:2]) + lean >= (g.h, g.l)):
        raise InputError(
            f"model {model.name}: the platform tips over; its centre of mass, payload included, "
            "must lie between the wheels, farther inside on a slope"
        )


def _wheel(model: Model, contact: Contact, wheel: Wheel, index: int) -> str:
    v, g, name = model.values, model.geometry, WHEELS[index]
    damping = v["mu1"] + v.get(f"uneven_wheel_friction.extra_{name}", 0.0)
    dry = v.get("wheel_coulomb_friction.torque", 0.0)
    inertia = _numbers((wheel.hub_across, wheel.hub_spin, wheel.hub_across))
    place = _numbers((SIGN_X[index] * g.h, SIGN_Y[index] * g.l, 0.0))
    rollers = (_roller(model, contact, wheel, index, k) for k in range(contact.rollers))
    return f"""
      <body pos="{place}">
        <joint name="{name}" axis="0 1 0" damping="{damping!r}" armature="{wheel.armature!r}"
            frictionloss="{dry!r}" solreffriction="{EngineSettings.contact_time!r} 1"
            solimpfriction="0.99 0.99 1"/>
        <inertial pos="0 0 0" mass="{wheel.hub!r}" diaginertia="{inertia}"/>
        {"".join(rollers)}
      </body>"""


def _roller(model: Model, contact: Contact, wheel: Wheel, index: int, k: int) -> str:
    """Roller ``k``; number 0 stands on the floor when the wheel angle is zero."""
    v, g = model.values, model.geometry
    # skew: angle between the roller's axis and X where it stands on the floor.
    turn, skew = 2 * math.pi * k / contact.rollers, math.atan(g.tangents[index])
    c, s = math.cos(turn), math.sin(turn)
    axis = (math.cos(skew) * c, math.sin(skew), -math.cos(skew) * s)
    place = (-(g.R - g.r) * s, 0.0, -(g.R - g.r) * c)
    half = roller_half_length(g, contact.rollers, g.slants[index])
    # With the inertia dt mu2 explicit damping stops a free roller in one step. With less its speed
    # would change sign in each step, and with less than half of it grow.
    spin = contact.timestep * v["mu2"]
    # A solid ellipsoid: m (b^2 + c^2) / 5 about an axis, with the other two half axes b and c.
    across, along = wheel.roller * (g.r**2 + half**2) / 5, 0.4 * wheel.roller * g.r**2
    inertia = _numbers((across, across, along))
    return f"""
        <body pos="{_numbers(place)}">
          <joint axis="{_numbers(axis)}" damping="{v["mu2"]!r}"
              armature="{max(spin - along, 0.0)!r}"/>
          <inertial pos="0 0 0" mass="{wheel.roller!r}" diaginertia="{inertia}"
              {_zaxis(axis)}/>
          <geom size="{_numbers((g.r, g.r, half))}" {_zaxis(axis)}/>
        </body>"""


def _zaxis(axis: tuple[float, float, float]) -> str:
    return f'zaxis="{_numbers(axis)}"'


def check_translatable(model: Model) -> None:
    """InputError if the model holds an effect that this plant cannot build."""
    for name in model.effects:
        if name not in TRANSLATED:
            raise InputError(
                f"model {model.name}: effect {name} cannot be built with contacts; a plant "
                f"'contact' knows {', '.join(TRANSLATED)}"
            )
