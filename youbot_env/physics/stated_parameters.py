"""Conversion between theta, which is identified, and the parameters in the form people state them.

Both follow the order of the structure's components: the base parameters under their own names, an
effect's as ``effect.parameter``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.physics.effect import Effect, Parameter
from youbot_env.physics.mechanism import Geometry, ModelStructure
from youbot_env.physics.namespaces import N, Namespace

Array = NDArray[np.float64]


def full_name(structure: ModelStructure[Geometry], item: Effect, name: str) -> str:
    """``effect.parameter``; a base parameter's own name."""
    return name if item.name in structure.mechanism.base else f"{item.name}.{name}"


def public_parameters(
    structure: ModelStructure[Geometry], geometry: Geometry
) -> dict[str, Parameter]:
    """The declarations of all parameters as people state them, by full name."""
    declared = structure.mechanism.declared
    return {
        full_name(structure, item, name): declared(item, geometry).public_parameter(name)
        for item in structure.components
        for name in item.public_names
    }


def to_public(
    structure: ModelStructure[Geometry], geometry: Geometry, theta: ArrayLike
) -> dict[str, float]:
    """Values as people state them, by full name, from theta (P,)."""
    values = np.asarray(theta, float)
    found: dict[str, float] = {}
    for item, where in structure.slices:
        stated = item.to_public(geometry, values[where])
        for name, value in zip(item.public_names, stated, strict=True):
            found[full_name(structure, item, name)] = float(value)
    return found


def to_theta(
    structure: ModelStructure[Geometry], geometry: Geometry, values: Mapping[str, float]
) -> Array:
    """theta (P,) from values as people state them, by full name."""
    return np.array(internal_values(np, structure, geometry, values), float)


def internal_values(
    xp: Namespace,
    structure: ModelStructure[Geometry],
    geometry: Geometry,
    values: Mapping[str, N],
) -> list[N]:
    """The P components of theta in the arithmetic of ``xp``, from values by full name."""
    theta: list[N] = []
    for item in structure.components:
        stated = [values[full_name(structure, item, name)] for name in item.public_names]
        theta += item.to_internal(xp, geometry, stated)
    return theta


def jacobian(structure: ModelStructure[Geometry], geometry: Geometry, theta: ArrayLike) -> Array:
    """(Q, P): derivatives of ``to_public``'s values with respect to theta.

    A row is zero where theta does not determine the value: the place of an anchor that does not
    pull.
    """
    theta = np.asarray(theta, float)
    found: list[Array] = []
    for item, where in structure.slices:
        count = len(item.public_names)
        block = np.zeros((count, len(theta)))
        # Without a form of its own a parameter is stated as it is.
        block[:, where] = _slopes(item, geometry, theta[where]) if item.public else np.eye(count)
        found.append(block)
    return np.concatenate(found)


def _slopes(item: Effect, geometry: object, theta: Array) -> Array:
    """(q, p): derivatives of an effect's public values with respect to its own."""

    def stated(shifted: Array) -> Array:
        return np.array(item.to_public(geometry, shifted), float)

    here = stated(theta)
    sizes = np.array([item.parameter(name).size for name in item.parameter_names])
    columns: list[Array] = []
    for index, step in enumerate(1e-6 * sizes):
        move = step * np.eye(len(theta))[index]
        ahead, behind = stated(theta + move) - here, here - stated(theta - move)
        # Where the two one-sided differences disagree, the smaller is right: a phase (atan2) jumps
        # by 2 pi on the other side.
        smaller = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
        smooth = np.abs(ahead - behind) < 1e-2 * np.abs(smaller)
        columns.append(np.where(smooth, 0.5 * (ahead + behind), smaller) / step)
    return np.stack(columns, axis=1)
