"""How a mecanum platform is identified: scaled as in the paper, shown by its calibration motions.

Forces are (L F_X, L F_Y, M_W) [N m] and speeds (VX/L, VY/L, W) [rad/s], so that all axes weigh
alike.
"""

from __future__ import annotations

from collections.abc import Mapping
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
from youbot_env.physics.mecanum import MECANUM, mecanum_structure
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


def _fault_of_fit(geometry: Geometry, values: Mapping[str, float]) -> str:
    if values["m0"] > 4 * geometry.m1:
        return ""
    return (
        f"the fitted mass m0 = {values['m0']:.3g} kg is below that of the four wheels "
        f"({4 * geometry.m1:.3g} kg): the logs do not show it; record motions "
        "I and II, or check the torques' unit and the geometry"
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
    fault_of_fit=_fault_of_fit,
    combinations=_combinations,
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
        super().__init__(geometry, structure, CONVENTIONS, settings)
