"""A platform on three omni wheels, 120 degrees apart: a third mechanism, said in one file.

Axes: VX, VY, W in the body frame. Joints: wheels whose rollers let it slide along their axles.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.mechanism import Conventions, Variables
from identification.mechanisms.quantities import FORCES, VELOCITIES, Quantities
from identification.mechanisms.samples import Samples, planar_pose
from identification.mechanisms.settings import MechanismSettings
from youbot_env.physics.effect import BODY, WHEEL, WORLD, Parameter, Registry, Wheel, effect
from youbot_env.physics.mecanum import body_points, into_body, planar_rates
from youbot_env.physics.mechanism import Components, EffectPoints, MechanismKind, Site
from youbot_env.physics.namespaces import N, Number

Array = NDArray[np.float64]

JOINTS = ("front", "left", "right")
ANGLES = (np.pi / 3, np.pi, -np.pi / 3)
"""Where the wheels stand, seen from the centre [rad]; each rolls across the line to it."""


class Lengths(NamedTuple):
    """Distance of the wheels from the centre and their radius [m]."""

    L: float = 0.2
    R: float = 0.05


def wheel_rates(lengths: Lengths, twist: Sequence[N]) -> Components[N]:
    vx, vy, wz = twist
    return tuple((np.cos(a) * vy - np.sin(a) * vx + lengths.L * wz) / lengths.R for a in ANGLES)


def body_force(lengths: Lengths, torque: Sequence[N]) -> Components[N]:
    f1, f2, f3 = (value / lengths.R for value in torque)
    (s1, s2, s3), (c1, c2, c3) = np.sin(ANGLES), np.cos(ANGLES)
    force_x, force_y = -s1 * f1 - s2 * f2 - s3 * f3, c1 * f1 + c2 * f2 + c3 * f3
    return force_x, force_y, lengths.L * (f1 + f2 + f3)


def wheel_torque(lengths: Lengths, force: Sequence[N]) -> Components[N]:
    fx, fy, mz = force
    return tuple(
        lengths.R / 3 * (2 * np.cos(a) * fy - 2 * np.sin(a) * fx + mz / lengths.L) for a in ANGLES
    )


def _wheels(points: EffectPoints[Lengths, Number]) -> list[Wheel]:
    at, lengths = points.at, points.geometry
    rows = zip(wheel_rates(lengths, at.twist), wheel_rates(lengths, at.acceleration), strict=True)
    return [Wheel(*row, 0.0, at.torque[i], at.time, points.base) for i, row in enumerate(rows)]


BASE, CATALOGUE = Registry(), Registry()


def _add(registry: Registry, place: Any, *parameters: Parameter) -> Any:
    said = partial(effect, source="textbook", recognise="In a test.", registry=registry)
    return said(acts_at=place, parameters=parameters)


@_add(BASE, BODY, Parameter("mass", "kg", lower=0, size=9), Parameter("inertia", "kg m^2", size=1))
def rigid_body(xp, body, mass, inertia):
    (vx, vy, wz), (ax, ay, alpha) = body.twist, body.acceleration
    return mass * (ax - wz * vy), mass * (ay + wz * vx), inertia * alpha


@_add(BASE, WHEEL, Parameter("spin", "kg m^2", lower=0.0, size=1e-2))
def wheel_inertia(xp, wheel, spin):
    return spin * wheel.acceleration


@_add(BASE, WHEEL, Parameter("viscous", "N m s", lower=0.0, size=0.05))
def wheel_friction(xp, wheel, viscous):
    return viscous * wheel.rate


@_add(CATALOGUE, WORLD, Parameter("slope_x", "N", size=2.0), Parameter("slope_y", "N", size=2.0))
def slope(xp, world, slope_x, slope_y):
    return slope_x, slope_y, 0.0


@_add(CATALOGUE, WHEEL, Parameter("torque", "N m", lower=0.0, size=0.1))
def dry_friction(xp, wheel, torque):
    return torque * xp.tanh(wheel.rate / 0.1)


OMNI = MechanismKind(
    name="omni",
    home=f"{__name__}:OMNI",
    axes=("VX", "VY", "W"),
    joints=JOINTS,
    base=BASE,
    catalogue=CATALOGUE,
    velocity_state=("velocity_x", "velocity_y", "yaw_rate"),
    pose_state=("x", "y", "yaw"),
    angle_state=(),
    drive_state=tuple(f"torque_{name}" for name in JOINTS),
    lengths=Lengths._fields,
    geometry=Lengths(),
    sites={
        BODY: Site(body_points, lambda points, force: tuple(force)),
        WHEEL: Site(_wheels, lambda points, torque: body_force(points.geometry, torque)),
        # Neither of the effects there asks where the platform is.
        WORLD: Site(body_points, into_body),
    },
    base_of=lambda points: tuple(points.theta[:4]),
    joint_rates=wheel_rates,
    force_of=body_force,
    torque_of=wheel_torque,
    pose_rates=planar_rates,
    full_speed=lambda lengths: (0.8, 0.8, 2.0),
    full_torque=lambda lengths: 2.0,
)


def samples_of(log: Log, lengths: Lengths, settings: MechanismSettings) -> Samples:
    rates = np.array([wheel_rates(lengths, tuple(unit)) for unit in np.eye(3)]).T
    twist = log.velocity @ np.linalg.pinv(rates).T
    pose = log.pose if log.pose is not None else planar_pose(twist, log.dt)
    time, none = log.time - log.time[0], np.empty((len(log), 0))
    return Samples(log.name, time, log.dt, twist, pose, none, log.velocity, log.effort)


def _variables(samples: Samples, lengths: Lengths) -> Variables:
    rates = np.column_stack([samples.twist, samples.wheel_speed])
    names = {"axes": ("x", "y", "yaw"), "joints": JOINTS, "places": ("x", "y")}
    heading, place = samples.pose[:, 2], samples.pose[:, :2]
    return Variables(**names, twist=samples.twist, rates=rates, position=place, heading=heading)


CONVENTIONS: Conventions[Lengths] = Conventions(
    kind=OMNI,
    axes=("VX", "VY", "W"),
    force_scale=lambda lengths: np.array([lengths.L, lengths.L, 1.0]),
    samples=samples_of,
    variables=_variables,
    quantities=lambda lengths: Quantities(FORCES, VELOCITIES, np.array([lengths.L] * 2 + [1.0])),
    advice=lambda lengths, direction: "record a motion along all axes too",
)
