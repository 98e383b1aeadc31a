"""How a mecanum platform is identified: scaled as in the paper, shown by its calibration motions.

Forces are (L F_X, L F_Y, M_W) [N m] and speeds (VX/L, VY/L, W) [rad/s], so that all axes weigh
alike.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.calibration_parts import parts_of
from identification.mechanisms.mecanum_motions import expected_samples, library
from identification.mechanisms.mecanum_samples import samples_of
from identification.mechanisms.mechanism import Conventions, Experiment, Mechanism, Variables
from identification.mechanisms.paper_regressor import (
    PAPER_ORDER,
    force_scale,
    motion_that_shows,
    paper_scale,
)
from identification.mechanisms.quantities import of_platform
from identification.mechanisms.samples import Samples
from identification.mechanisms.settings import MechanismSettings
from youbot_env.motions.base import Motion
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_env.physics.mecanum import MECANUM, mecanum_kind, mecanum_structure
from youbot_env.physics.mechanism import ModelStructure

Array = NDArray[np.float64]


def _advice(geometry: Geometry, direction: Array) -> str:
    return (
        f"record motion {motion_that_shows(geometry, direction)} too "
        f"(youbot record --motions, or drive it) and give both logs"
    )


def _motions(geometry: Geometry, seed: int) -> list[Experiment]:
    """Calibration motions, multisines and steps within the platform's limits."""

    def expected(motion: Motion, theta: Array) -> Samples:
        values = dict(zip(BASE.base_names, theta, strict=False))
        return expected_samples(motion, geometry, values)

    return [
        Experiment(motion.name, motion.to_dict(), partial(expected, motion))
        for motion in library(geometry, seed)
    ]


def _variables(samples: Samples, geometry: Geometry) -> Variables:
    rolling = geometry.wheel_speeds(samples.twist)
    rollers = samples.twist @ geometry.roller_jacobian[::2].T
    return Variables(
        axes=("x", "y", "yaw"),
        joints=WHEELS,
        places=("x", "y"),
        twist=samples.twist,
        rates=np.column_stack([samples.twist, rolling, rollers]),
        position=samples.pose[:, :2],
        heading=samples.pose[:, 2],
        angle=samples.wheel_angle,
        speed=samples.wheel_speed,
        departure=samples.wheel_speed - rolling,
    )


def _limits(geometry: Geometry, theta: Array, settings: MechanismSettings) -> dict[str, float]:
    """How far m0 and I0 are above what masses can be, in kg: negative where no masses do.

    The platform weighs more than its wheels. Mass m whose centre lies at a distance a from O has a
    yaw inertia of m a^2 or more about O: [[m, m a], [m a, I0]] is positive semidefinite, and its
    least eigenvalue, with lengths in units of the wheels' distance, is concave in theta.
    """
    inertia = theta[1] / _corner(geometry) ** 2
    moment = float(np.hypot(theta[2], theta[3])) / _corner(geometry)
    mass, least = theta[0] - 4 * geometry.m1, _least_mass(geometry, settings)
    lowest = 0.5 * (mass + inertia - float(np.hypot(mass - inertia, 2 * moment)))
    # Half of it, so that a mass at its limit leaves room for a centre of mass.
    return {"m0": mass - least, "I0": lowest - 0.5 * least}


def _inside(geometry: Geometry, theta: Array, settings: MechanismSettings) -> Array:
    """The nearest mass and inertia well within the limits; the centre of mass moves inwards."""
    least, found = 2 * _least_mass(geometry, settings), theta.copy()
    mass = max(theta[0] - 4 * geometry.m1, least)
    inertia = max(theta[1] / _corner(geometry) ** 2, least)
    found[:2] = mass + 4 * geometry.m1, inertia * _corner(geometry) ** 2
    moment = float(np.hypot(theta[2], theta[3])) / _corner(geometry)
    # A quarter of each: the least eigenvalue is then above half of the smaller one.
    found[2:4] *= min(1.0, 0.25 * min(mass, inertia) / max(moment, 1e-300))
    return found


def _corner(geometry: Geometry) -> float:
    return float(np.hypot(geometry.l, geometry.h))


def _least_mass(geometry: Geometry, settings: MechanismSettings) -> float:
    """Of the platform without its wheels [kg]."""
    return max(settings.min_platform_mass_share * 4 * geometry.m1, settings.min_platform_mass)


def _doubt_of_unit(geometry: Geometry, theta: Array, settings: MechanismSettings) -> str:
    """A mass that no such platform has, which speeds in turns/s would make of an ordinary one."""
    # What a wheel feels of the mass: shown even where m0 and I1 are not told apart.
    felt = float(theta[0] + 4 * theta[4] / geometry.R**2)
    if felt < settings.max_platform_mass * max(1.0, geometry.bulk):
        return ""
    turn = 2 * np.pi
    return (
        f"the logs show a mass of {felt:.0f} kg: are velocity_* in turns/s? multiplied by "
        f"{turn:.5f} to rad/s they show {felt / turn:.0f} kg"
    )


def _combinations(geometry: Geometry) -> dict[str, dict[str, float]]:
    """What resists when all wheels speed up: the wheels' spin is added to mass and yaw inertia."""
    spin = 4 / geometry.R**2
    return {
        "m0 + 4 I1/R^2": {"m0": 1.0, "I1": spin},
        "I0 + 4 I1 L^2/R^2": {"I0": 1.0, "I1": spin * geometry.L**2},
    }


BASE = mecanum_structure()

CONVENTIONS: Conventions[Geometry] = Conventions(
    kind=MECANUM,
    axes=("VX", "VY", "W"),
    force_scale=force_scale,
    samples=samples_of,
    variables=_variables,
    quantities=of_platform,
    advice=_advice,
    base_scale=paper_scale,
    scaling="as in the paper",
    order=PAPER_ORDER,
    parts=parts_of,
    motions=_motions,
    combinations=_combinations,
    least=lambda geometry: {"m0": 4 * geometry.m1},
    limits=_limits,
    inside=_inside,
    doubt_of_unit=_doubt_of_unit,
    motion_that_shows=motion_that_shows,
)
"""Of the mecanum platform."""


class Mecanum(Mechanism[Geometry]):
    """A mecanum platform with given effects, as its logs show it."""

    def __init__(
        self,
        geometry: Geometry,
        structure: ModelStructure[Geometry] = BASE,
        settings: MechanismSettings = MechanismSettings(),
    ) -> None:
        structure = replace(structure, mechanism=mecanum_kind(geometry))
        super().__init__(geometry, structure, CONVENTIONS, settings)
