"""Candidate effects at a fitted model: columns, held-out residuals, who resembles whom."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.cross_validation import Fold, HeldOut, held_out, make_folds
from identification.fitting.errors import NoiseLevel
from identification.fitting.least_squares import gauge_basis
from identification.fitting.regression_rows import (
    Indices,
    Rows,
    reduce,
    regression_rows,
    residual_of,
)
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import DemandedForce
from youbot_env.physics.effect import Parameter

Array = NDArray[np.float64]

SELECTION = FitSettings(row_rate=50.0)
"""Rows a second [Hz] for the choice of effects: torque ripple lives above what a fit needs."""


@dataclass(frozen=True)
class Fitted:
    """A structure at parameters theta, with its rows: what candidates are added to."""

    mechanism: Any
    theta: Array
    rows: tuple[Rows, ...]
    free: Indices
    basis: Array
    samples: tuple[Any, ...]

    @classmethod
    def at(cls, mechanism: Any, theta: Array, samples: Sequence[Any], free: Indices) -> Fitted:
        """Rows of all logs at theta; ``free``: indices of the parameters that were fitted."""
        rows = tuple(regression_rows(mechanism, theta, item, free, SELECTION) for item in samples)
        return cls(mechanism, theta, rows, free, _directions(mechanism, free), tuple(samples))

    @cached_property
    def demands(self) -> tuple[DemandedForce, ...]:
        """Of each log: what candidates on top of the structure need not find out again."""
        return tuple(self.mechanism.demand(self.theta, item) for item in self.samples)

    @property
    def residual(self) -> list[Array]:
        """Per log (n, A)."""
        return [row.residual for row in self.rows]

    @property
    def square(self) -> float:
        """Sum of the squared residuals of all rows."""
        return sum(float((row.residual**2).sum()) for row in self.rows)

    @property
    def columns(self) -> list[Array]:
        """Per log (n, A, F)."""
        return [row.columns for row in self.rows]

    def noise_square(self, noise: Sequence[NoiseLevel], seed: int) -> float:
        """Squares that noise on the speeds leaves in the residual, by putting it on once more."""
        rng = np.random.default_rng(seed)
        total = 0.0
        for item, of, row in zip(self.samples, noise, self.rows, strict=True):
            noisy = self.mechanism.noisy(item, of.speed, 0.0 * of.torque, rng)
            again = residual_of(self.mechanism, self.theta, noisy, SELECTION)
            total += float(((again - row.residual) ** 2).sum())
        return total

    @cached_property
    def held_out(self) -> HeldOut:
        """Judged on what it was not fitted on."""
        return self.judged(make_folds(self.rows, self.columns))

    def judged(self, folds: Sequence[Fold]) -> HeldOut:
        """The same with other folds."""
        return held_out(self.residual, self.columns, folds, self.basis)

    def compared(self, folds: Sequence[Fold]) -> float:
        """Its held-out squares over those with other folds."""
        own = self.held_out
        return 1.0 if tuple(folds) == own.folds else own.square / self.judged(folds).square


def _directions(mechanism: Any, free: Indices) -> Array:
    """(F, Q) directions of the parameters ``free`` that data can see, in their own units."""
    return gauge_basis(mechanism, free) / mechanism.scale[free][:, None]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, at one choice of its shape constants, on top of a fitted structure.

    free : indices of its own linear parameters and the structure's
    directions : that data can see of its own linear parameters
    extra_noise : squares that noise on the speeds adds to the residual beyond what it adds to the
        structure's: a drive's lag differentiates the noise, and must not lose by that alone
    folding : the structure's held-out squares over those with the candidate's folds: finer ones
        hold less out, and are no merit of the candidate
    unkept : squares whose fall the held-out steps promise and the joint fit does not keep: they
        know no bounds, and may well need a negative inertia
    """

    name: str
    mechanism: Any
    theta: Array
    free: Indices
    columns: tuple[Array, ...]
    result: HeldOut
    shapes: dict[str, float] = field(default_factory=dict)
    directions: int = 0
    fitted: Fitted | None = None
    extra_noise: float = 0.0
    folding: float = 1.0
    unkept: float = 0.0

    @property
    def square(self) -> float:
        """Sum of squared held-out residuals, at the structure's own noise and folds."""
        return self.noisy_square - self.extra_noise + self.unkept

    @property
    def noisy_square(self) -> float:
        """The same at its own noise."""
        return self.folding * self.result.square

    @property
    def parameters(self) -> int:
        """How many numbers it adds, searched shapes included: the price of its flexibility."""
        return self.directions + len(self.shapes)


REFINEMENTS = 3
"""Halvings of a grid's step around its best value."""


def try_candidate(base: Fitted, name: str) -> Candidate:
    """The effect at its best shape, judged by held-out squares: on the grid, then between."""
    mechanism = base.mechanism.extended(name)
    longest = max(float(item.time[-1]) for item in base.samples)
    grids = {p.name: _grid(p, longest) for p in mechanism.catalogue[name].parameters if p.grid}

    def judge(values: tuple[float, ...]) -> Candidate:
        shapes = dict(zip(grids, values, strict=True))
        return _try_shape(base, mechanism, name, shapes)

    best = min(map(judge, itertools.product(*grids.values())), key=_square)
    if best.square > PROMISING * base.held_out.square:
        return best
    for shape, grid in grids.items():
        parameter = mechanism.catalogue[name].parameter(shape)
        if parameter.whole:
            continue
        for halving in range(1, REFINEMENTS + 1):
            here = best.shapes[shape]
            for value in _between(grid, here, halving, parameter):
                values = tuple((best.shapes | {shape: value})[key] for key in grids)
                best = min(best, judge(values), key=_square)
    return best


def _grid(parameter: Parameter, longest: float) -> tuple[float, ...]:
    """Values to try; instants of a log up to the end of the longest one [s]."""
    grid = parameter.grid
    if not parameter.instant:
        return grid
    step = grid[-1] - grid[-2]
    more = np.arange(grid[-1] + step, longest, step)
    return tuple(value for value in (*grid, *more.tolist()) if value < longest)


PROMISING = 0.98
"""Share of the base's squares above which no finer search is worth its time."""


def _square(item: Candidate) -> float:
    return item.square


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
    name: str,
    shapes: dict[str, float],
) -> Candidate:
    theta = mechanism.extend_theta(base.theta, name, shapes)
    own = np.arange(len(base.theta), len(theta), dtype=np.intp)
    new = own[mechanism.free[own]]
    columns = tuple(
        _columns(mechanism, mechanism.demand(theta, item, known), item, new)
        for item, known in zip(base.samples, base.demands, strict=True)
    )
    joined = [np.concatenate([a, b], axis=-1) for a, b in zip(base.columns, columns, strict=True)]
    free = np.concatenate([base.free, new])
    basis = _directions(mechanism, free)
    folds = make_folds(base.rows, joined)
    result = held_out(base.residual, joined, folds, basis)
    directions = basis.shape[1] - base.basis.shape[1]
    return Candidate(
        *(name, mechanism, theta, free, columns, result, shapes),
        directions=directions,
        folding=base.compared(folds),
    )


def _columns(mechanism: Any, demand: DemandedForce, samples: Any, new: Indices) -> Array:
    ends = np.moveaxis(demand.columns(new), 0, -1)
    return reduce(ends, mechanism, samples, SELECTION)


def contains(larger: Candidate, smaller: Candidate, base: Fitted, enough: float = 0.995) -> bool:
    """Whether the larger candidate's columns can imitate the smaller one's (a nested effect)."""
    if larger.parameters <= smaller.parameters:
        return False
    return _imitates(_flat(larger.columns), _flat(smaller.columns), _flat(base.columns), enough)


def extends(item: Candidate, base: Fitted, enough: float = 0.995) -> bool:
    """Whether a candidate's columns can imitate those of an effect that the structure holds."""
    columns = _flat(base.columns)
    for effect in base.mechanism.structure.effects:
        its = np.array([base.mechanism.labels[k].component == effect for k in base.free])
        fewer = its.any() and its.sum() < item.parameters
        if fewer and _imitates(_flat(item.columns), columns[:, its], columns[:, ~its], enough):
            return True
    return False


def _flat(columns: Sequence[Array]) -> Array:
    """Columns (n, A, F) of all logs, in one (N, F)."""
    return np.concatenate([part.reshape(-1, part.shape[-1]) for part in columns])


def _imitates(columns: Array, target: Array, nuisance: Array, enough: float) -> bool:
    """Whether columns explain all but ``1 - enough`` of what others leave of the targets."""
    left_base = unexplained(nuisance, target)
    left_both = unexplained(np.concatenate([nuisance, columns], axis=1), target)
    return bool((left_both < (1 - enough) * left_base).all())


def unexplained(columns: Array, target: Array) -> Array:
    """Squares (T,) of targets (n, T) that no combination of columns (n, F) explains."""
    norm = np.sqrt((columns**2).sum(axis=0))
    columns = columns / np.where(norm > 0, norm, 1.0)
    gram = columns.T @ columns
    rest = target - columns @ (np.linalg.pinv(gram, rcond=1e-10) @ (columns.T @ target))
    return (rest**2).sum(axis=0)
