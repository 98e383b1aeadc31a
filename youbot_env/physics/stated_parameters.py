"""A whole model's parameters between theta, which is identified, and the form that people state.

Both follow the order of the structure's components: the base parameters under their own names, an
effect's as ``effect.parameter``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.physics.effect import BASE, Effect, Parameter
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.structure import ModelStructure

Array = NDArray[np.float64]


def full_name(item: Effect, name: str) -> str:
    """``effect.parameter``; a base parameter's own name."""
    return name if item.name in BASE else f"{item.name}.{name}"


def public_parameters(structure: ModelStructure) -> dict[str, Parameter]:
    """The declarations of all parameters as people state them, by full name."""
    return {
        full_name(item, name): item.public_parameter(name)
        for item in structure.components
        for name in item.public_names
    }


def to_public(structure: ModelStructure, geometry: Geometry, theta: ArrayLike) -> dict[str, float]:
    """Values as people state them, by full name, from theta (P,)."""
    values = np.asarray(theta, float)
    found: dict[str, float] = {}
    for item, where in structure.slices:
        stated = item.to_public(geometry, values[where])
        for name, value in zip(item.public_names, stated, strict=True):
            found[full_name(item, name)] = float(value)
    return found


def to_theta(structure: ModelStructure, geometry: Geometry, values: Mapping[str, float]) -> Array:
    """theta (P,) from values as people state them, by full name."""
    return np.array(internal_values(np, structure, geometry, values), float)


def internal_values(
    xp: Any, structure: ModelStructure, geometry: Geometry, values: Mapping[str, Any]
) -> list[Any]:
    """The P components of theta in the arithmetic of ``xp``, from values by full name."""
    theta: list[Any] = []
    for item in structure.components:
        stated = [values[full_name(item, name)] for name in item.public_names]
        theta += item.to_internal(xp, geometry, stated)
    return theta


def jacobian(structure: ModelStructure, geometry: Geometry, theta: ArrayLike) -> Array:
    """(Q, P): derivatives of ``to_public``'s values with respect to theta.

    A row of zeros belongs to a value that theta does not show (the place of an anchor that does
    not pull).
    """
    theta = np.asarray(theta, float)

    def stated(shifted: Array) -> Array:
        return np.array(list(to_public(structure, geometry, shifted).values()))

    here = stated(theta)
    columns = []
    for index, step in enumerate(1e-6 * np.array(_sizes(structure.components))):
        move = step * np.eye(len(theta))[index]
        ahead, behind = stated(theta + move) - here, here - stated(theta - move)
        # Of the two sides the flatter: a phase may wrap on the other.
        smaller = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
        smooth = np.abs(ahead - behind) < 1e-2 * np.abs(smaller)
        columns.append(np.where(smooth, 0.5 * (ahead + behind), smaller) / step)
    return np.stack(columns, axis=1)


def _sizes(components: Sequence[Effect]) -> list[float]:
    return [item.parameter(name).size for item in components for name in item.parameter_names]
