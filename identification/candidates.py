"""Candidate effects at a fitted model: columns, held-out residuals, who resembles whom."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.folds import Fold, HeldOut, held_out
from identification.regression import Indices, Rows, gauge_basis, reduce, regression_rows
from youbot_env.effects import Parameter

Array = NDArray[np.float64]

RATE = 50.0
"""Rows a second [Hz] for the choice of effects: torque ripple lives above what a fit needs."""


@dataclass(frozen=True)
class Fitted:
    """A structure at parameters theta, with its rows: what candidates are added to."""

    mechanism: Any
    theta: Array
    rows: tuple[Rows, ...]
    free: Indices
    basis: Array

    @classmethod
    def at(cls, mechanism: Any, theta: Array, samples: Sequence[Any]) -> Fitted:
        """Rows of all logs at theta."""
        free = np.flatnonzero(mechanism.free)
        rows = tuple(regression_rows(mechanism, theta, item, free, RATE) for item in samples)
        basis = gauge_basis(mechanism) / mechanism.scale[free][:, None]
        return cls(mechanism, theta, rows, free, basis)

    @property
    def residual(self) -> list[Array]:
        """Per log (n, A)."""
        return [row.residual for row in self.rows]

    @property
    def columns(self) -> list[Array]:
        """Per log (n, A, F)."""
        return [row.columns for row in self.rows]

    def held_out(self, folds: Sequence[Fold]) -> HeldOut:
        """Judged on what it was not fitted on."""
        return held_out(self.residual, self.columns, folds, self.basis)


@dataclass(frozen=True)
class Candidate:
    """One effect, at one choice of its shape constants, on top of a fitted structure."""

    name: str
    mechanism: Any
    theta: Array
    new: Indices
    columns: tuple[Array, ...]
    result: HeldOut
    shapes: dict[str, float] = field(default_factory=dict)
    base_size: int = 0
    fitted: Fitted | None = None

    @property
    def parameters(self) -> int:
        """How many numbers it adds, searched shapes included: the price of its flexibility."""
        return self.basis_size + len(self.shapes)

    @property
    def basis_size(self) -> int:
        """Directions that data can see of its linear parameters."""
        return gauge_basis(self.mechanism).shape[1] - self.base_size


REFINEMENTS = 3
"""Halvings of a grid's step around its best value."""


def try_candidate(
    base: Fitted, samples: Sequence[Any], folds: Sequence[Fold], name: str
) -> Candidate:
    """The effect at its best shape, judged by held-out squares: on the grid, then between."""
    mechanism = base.mechanism.extended(name)
    grids = {p.name: p.grid for p in mechanism.catalogue[name].parameters if p.grid}

    def judge(values: tuple[float, ...]) -> Candidate:
        shapes = dict(zip(grids, values, strict=True))
        return _try_shape(base, mechanism, samples, folds, name, shapes)

    best = min(map(judge, itertools.product(*grids.values())), key=_square)
    if best.result.square > PROMISING * base.held_out(folds).square:
        return best
    for shape, grid in grids.items():
        parameter = mechanism.catalogue[name].parameter(shape)
        if all(float(value).is_integer() for value in grid) and grid[1] - grid[0] == 1:
            continue  # cycles a turn: there is nothing between
        for halving in range(1, REFINEMENTS + 1):
            here = best.shapes[shape]
            for value in _between(grid, here, halving, parameter):
                values = tuple((best.shapes | {shape: value})[key] for key in grids)
                best = min(best, judge(values), key=_square)
    return best


PROMISING = 0.98
"""Share of the base's squares above which no finer search is worth its time."""


def _square(item: Candidate) -> float:
    return item.result.square


def _between(grid: Sequence[float], here: float, halving: int, parameter: Parameter) -> list[float]:
    """Values half, a quarter, ... of the grid's local step to both sides of ``here``."""
    points = np.asarray(grid)
    near = int(np.argmin(np.abs(points - here)))
    left = points[near] - points[near - 1] if near > 0 else 0.0
    right = points[near + 1] - points[near] if near + 1 < len(points) else left
    steps = (-(left or right) / 2**halving, right / 2**halving)
    tried = (float(here + step) for step in steps)
    return [value for value in tried if parameter.lower <= value <= parameter.upper]


def _try_shape(
    base: Fitted,
    mechanism: Any,
    samples: Sequence[Any],
    folds: Sequence[Fold],
    name: str,
    shapes: dict[str, float],
) -> Candidate:
    theta = mechanism.extend_theta(base.theta, name, shapes)
    own = np.arange(len(base.theta), len(theta), dtype=np.intp)
    new = own[mechanism.free[own]]
    columns = tuple(_columns(mechanism, theta, item, new) for item in samples)
    joined = [np.concatenate([a, b], axis=-1) for a, b in zip(base.columns, columns, strict=True)]
    free = np.flatnonzero(mechanism.free)
    basis = gauge_basis(mechanism) / mechanism.scale[free][:, None]
    result = held_out(base.residual, joined, folds, basis)
    return Candidate(
        name, mechanism, theta, new, columns, result, shapes, base_size=base.basis.shape[1]
    )


def _columns(mechanism: Any, theta: Array, samples: Any, new: Indices) -> Array:
    ends = np.moveaxis(mechanism.demand(theta, samples).columns(new), 0, -1)
    return reduce(ends, samples.dt, RATE, mechanism.filter_rate)


def contains(larger: Candidate, smaller: Candidate, base: Fitted, enough: float = 0.995) -> bool:
    """Whether the larger candidate's columns can imitate the smaller one's (a nested effect)."""
    if larger.parameters <= smaller.parameters:
        return False
    target = np.concatenate([c.reshape(-1, c.shape[-1]) for c in smaller.columns])
    nuisance = np.concatenate([c.reshape(-1, c.shape[-1]) for c in base.columns])
    both = np.concatenate(
        [nuisance, np.concatenate([c.reshape(-1, c.shape[-1]) for c in larger.columns])], axis=1
    )
    left_base = _unexplained(nuisance, target)
    left_both = _unexplained(both, target)
    return bool((left_both < (1 - enough) * left_base).all())


def _unexplained(columns: Array, target: Array) -> Array:
    norm = np.sqrt((columns**2).sum(axis=0))
    columns = columns / np.where(norm > 0, norm, 1.0)
    gram = columns.T @ columns
    rest = target - columns @ (np.linalg.pinv(gram, rcond=1e-10) @ (columns.T @ target))
    return (rest**2).sum(axis=0)
