"""Held-out shares of a residual that groups of features explain, with a bootstrap null.

All work is on normal equations: features are the same on every axis of force, each axis has its
own coefficients, and the model's own columns are fitted along. Ridge regressions for all strengths
come from one eigendecomposition, and those of all bootstrap draws from the same one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.settings import FitSettings

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

RIDGE = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
"""Strengths over the number of rows, for features of unit size."""

KEPT = 3
"""Orders of a group of sines and cosines that are kept, the strongest in the training part."""

DRAWS = 499
"""Bootstrap draws: a level of 1 % rests on the five largest."""

RELEVANT = 0.001
"""Shares of this order are within chance, however long the logs: significance is not relevance."""

_JITTER = 1e-8


@dataclass(frozen=True)
class Part:
    """Rows of one fold: features (n, Q), model columns (n, A, P), residual (n, A); step [s]."""

    features: Array
    columns: Array
    residual: Array
    step: float

    @cached_property
    def grams(self) -> Grams:
        """Normal equations, right-hand sides aside."""
        by_axis = np.moveaxis(self.columns, 1, 0)
        return Grams(
            len(self.residual),
            sum((c.T @ c for c in by_axis), start=np.zeros((self.columns.shape[2],) * 2)),
            np.stack([c.T @ self.features for c in by_axis]),
            self.features.T @ self.features,
        )

    @property
    def block(self) -> int:
        """Rows whose signs are drawn together."""
        return max(1, round(FitSettings.independent_time / self.step))

    def pieces(self, count: int) -> list[Part]:
        """As many contiguous pieces."""
        edges = np.linspace(0, len(self.residual), count + 1).astype(int)
        return [
            Part(self.features[a:b], self.columns[a:b], self.residual[a:b], self.step)
            for a, b in zip(edges, edges[1:], strict=False)
        ]

    def scores(self, residual: Array) -> tuple[Array, Array]:
        """Sums of columns (blocks, P) and features (blocks, A, Q) times a residual, by block."""
        starts = np.arange(0, len(residual), self.block)
        own = np.add.reduceat(np.einsum("na,nap->np", residual, self.columns), starts)
        blocks = [slice(a, a + self.block) for a in starts]
        return own, np.stack([residual[rows].T @ self.features[rows] for rows in blocks])


@dataclass(frozen=True)
class Grams:
    """Products of model columns (P, P), of these with features (A, P, Q), of features (Q, Q)."""

    rows: int
    own: Array
    cross: Array
    features: Array

    def __add__(self, other: Grams) -> Grams:
        return Grams(
            self.rows + other.rows,
            self.own + other.own,
            self.cross + other.cross,
            self.features + other.features,
        )

    def __sub__(self, other: Grams) -> Grams:
        return Grams(
            self.rows - other.rows,
            self.own - other.own,
            self.cross - other.cross,
            self.features - other.features,
        )

    def nuisance(self, chosen: Indices) -> Array:
        """Model columns and chosen features on all axes: (P + A q, P + A q)."""
        across = self._across(chosen)
        return np.block([[self.own, across], [across.T, self.block(chosen, chosen)]])

    def against(self, chosen: Indices, group: Indices) -> Array:
        """Those with a group's features: (P + A q, A g)."""
        return np.concatenate([self._across(group), self.block(chosen, group)])

    def block(self, left: Indices, right: Indices) -> Array:
        """Features with features, all axes: (A q, A g)."""
        axes, block = len(self.cross), self.features[np.ix_(left, right)]
        found = np.zeros((axes, len(left), axes, len(right)))
        found[range(axes), :, range(axes)] = block
        return found.reshape(axes * len(left), axes * len(right))

    def _across(self, chosen: Indices) -> Array:
        return np.concatenate(list(self.cross[:, :, chosen]), axis=1)


@dataclass(frozen=True)
class Sides:
    """Right-hand sides of one fold for D residuals: own (P, D), features (A, Q, D)."""

    own: Array
    features: Array

    def __add__(self, other: Sides) -> Sides:
        return Sides(self.own + other.own, self.features + other.features)

    def __sub__(self, other: Sides) -> Sides:
        return Sides(self.own - other.own, self.features - other.features)

    def of(self, group: Indices) -> Array:
        """(A g, D)."""
        return np.concatenate(list(self.features[:, group]))

    def nuisance(self, chosen: Indices) -> Array:
        """(P + A q, D)."""
        return np.concatenate([self.own, self.of(chosen)])


def draw_signs(parts: Sequence[Part], seed: int) -> Array:
    """(DRAWS, blocks) random signs, one for each block of all folds in turn."""
    blocks = sum(-(-len(part.residual) // part.block) for part in parts)
    return np.random.default_rng(seed).choice([-1.0, 1.0], size=(DRAWS, blocks))


def sides_of(parts: Sequence[Part], null: Sequence[Array], signs: Array) -> list[Sides]:
    """Sides of each fold's residual and, behind it, of ``null`` residuals with random signs."""
    found, start = [], 0
    for part, residual in zip(parts, null, strict=True):
        own, features = part.scores(residual)
        chosen = signs[:, start : start + len(own)].T
        start += len(own)
        real_own, real = (block.sum(axis=0) for block in part.scores(part.residual))
        drawn = np.moveaxis(np.tensordot(chosen, features, (0, 0)), 0, -1)
        found.append(
            Sides(
                np.column_stack([real_own, own.T @ chosen]),
                np.concatenate([real[..., None], drawn], axis=-1),
            )
        )
    return found


@dataclass(frozen=True)
class Nuisance:
    """What is fitted along: the model's columns and features under a ridge of given strength."""

    chosen: Indices
    ridge: float

    def inverse(self, grams: Grams) -> Array:
        """Of the penalised normal matrix (M, M)."""
        matrix = grams.nuisance(self.chosen)
        own = len(grams.own)
        penalty = np.full(len(matrix), self.ridge * grams.rows)
        penalty[:own] = 0.0
        matrix = matrix + np.diag(penalty)
        size = np.sqrt(np.diag(matrix))
        size = np.where(size > 0, size, 1.0)
        scaled = matrix / np.outer(size, size) + _JITTER * np.eye(len(matrix))
        return np.linalg.inv(scaled) / np.outer(size, size)


@dataclass(frozen=True)
class Gain:
    """Squares that a group explains on what is held out, beyond the nuisance.

    by_strength (R, K, D): for each ridge, fold and residual. The ridge is the one that does best
    over all folds: one choice out of five, which the draws of the null have too. Chosen without a
    fold, it would often be too weak for it, where the others are alike and it is not.
    """

    by_strength: Array

    @property
    def total(self) -> Array:
        """(D,) over all folds."""
        return self.by_strength.sum(axis=1).max(axis=0)

    @property
    def strength(self) -> tuple[float, float]:
        """The ridge that does best for the real residual, and its gain."""
        real = self.by_strength[..., 0].sum(axis=1)
        return RIDGE[int(real.argmax())], float(real.max())


def gains(
    parts: Sequence[Part],
    sides: Sequence[Sides],
    nuisance: Nuisance,
    groups: Sequence[tuple[Indices, bool]],
) -> list[Gain]:
    """What each group of features (indices, whether in pairs) explains of each held-out fold."""
    grams, side = add_up([part.grams for part in parts]), add_up(sides)
    found: list[list[Array]] = [[] for _ in groups]
    for part, held in zip(parts, sides, strict=True):
        fold = Fold(nuisance, grams - part.grams, side - held, part.grams, held)
        for gained, (group, pairs) in zip(found, groups, strict=True):
            gained.append(fold.beyond(group).gain(KEPT if pairs else None))
    return [Gain(np.stack(by_fold, axis=1)) for by_fold in found]


@dataclass(frozen=True)
class Fold:
    """Training and held-out normal equations; the nuisance is fitted to the training part."""

    nuisance: Nuisance
    training: Grams
    right: Sides
    held: Grams
    held_right: Sides

    @cached_property
    def inverse(self) -> Array:
        return self.nuisance.inverse(self.training)

    @cached_property
    def fitted(self) -> Array:
        """(M, D) the nuisance's coefficients without any group."""
        return self.inverse @ self.right.nuisance(self.nuisance.chosen)

    @cached_property
    def own(self) -> Array:
        """(M, M) held-out normal matrix of the nuisance."""
        return self.held.nuisance(self.nuisance.chosen)

    @cached_property
    def left(self) -> Array:
        """(M, D) held-out sides of the nuisance after its prediction."""
        return self.held_right.nuisance(self.nuisance.chosen) - self.own @ self.fitted

    def beyond(self, group: Indices) -> Equations:
        """A group's equations with the nuisance fitted along (Frisch, Waugh and Lovell)."""
        chosen = self.nuisance.chosen
        across = self.training.against(chosen, group)
        absorbed = self.inverse @ across
        seen = self.held.against(chosen, group)
        mixed = seen.T @ absorbed
        return Equations(
            rows=self.training.rows,
            axes=len(self.training.cross),
            normal=self.training.block(group, group) - across.T @ absorbed,
            target=self.right.of(group) - across.T @ self.fitted,
            shape=self.held.block(group, group)
            - mixed
            - mixed.T
            + absorbed.T @ (self.own @ absorbed),
            answer=self.held_right.of(group) - seen.T @ self.fitted - absorbed.T @ self.left,
        )


@dataclass(frozen=True)
class Equations:
    """Of a group's S = A g coefficients b, for D residuals.

    Fitted by (normal + ridge) b = target; what is held out gains 2 b' answer - b' shape b.
    """

    rows: int
    axes: int
    normal: Array
    target: Array
    shape: Array
    answer: Array

    def gain(self, kept: int | None) -> Array:
        """(R, D) for each ridge; kept: how many orders of a group in pairs."""
        return self._ridge() if kept is None else self._strongest(kept)

    def _ridge(self) -> Array:
        values, vectors = np.linalg.eigh(self.normal)
        target, answer = vectors.T @ self.target, vectors.T @ self.answer
        shape = vectors.T @ self.shape @ vectors
        found = []
        for strength in RIDGE:
            solution = target / (np.maximum(values, 0.0) + strength * self.rows)[:, None]
            found.append((solution * (2 * answer - shape @ solution)).sum(axis=0))
        return np.stack(found)

    def _strongest(self, kept: int) -> Array:
        """Orders are all but orthogonal to each other: each is fitted alone."""
        size = np.maximum(np.diag(self.normal), 1e-9 * self.rows)[:, None]
        scores = (self.target**2 / size).reshape(self.axes, -1, 2, self.target.shape[1])
        by_order = scores.sum(axis=(0, 2))
        least = np.partition(by_order, -kept, axis=0)[-kept]
        mask = np.tile(np.repeat(by_order >= least, 2, axis=0), (self.axes, 1))
        found = []
        for strength in RIDGE:
            solution = mask * self.target / (size + strength * self.rows)
            found.append((solution * (2 * self.answer - self.shape @ solution)).sum(axis=0))
        return np.stack(found)


def add_up(items: Sequence[Any]) -> Any:
    """The sum of what adds."""
    first, *rest = items
    return sum(rest, start=first)


def base_squares(parts: Sequence[Part], sides: Sequence[Sides]) -> float:
    """Held-out squares of the residual with the model's own parameters fitted without each fold."""
    nothing = Nuisance(np.zeros(0, np.intp), 0.0)
    grams, side = add_up([part.grams for part in parts]), add_up(sides)
    total = 0.0
    for part, held in zip(parts, sides, strict=True):
        fitted = nothing.inverse(grams - part.grams) @ (side - held).own[:, 0]
        total += float(((part.residual - part.columns @ fitted) ** 2).sum())
    return total


def left_over(parts: Sequence[Part], nuisance: Nuisance) -> list[Array]:
    """Residuals (n, A) of each fold after a fit of the nuisance to all of them."""
    grams = add_up([part.grams for part in parts])
    own = sum(np.einsum("na,nap->p", part.residual, part.columns) for part in parts)
    flexible = sum(part.residual.T @ part.features[:, nuisance.chosen] for part in parts)
    fitted = nuisance.inverse(grams) @ np.concatenate([own, np.ravel(flexible)])
    size = len(grams.own)
    weights = fitted[size:].reshape(len(grams.cross), -1).T
    return [
        part.residual - part.columns @ fitted[:size] - part.features[:, nuisance.chosen] @ weights
        for part in parts
    ]


def strongest_order(parts: Sequence[Part], residual: Sequence[Array], group: Indices) -> int:
    """Which of a group's orders (from 0) explains most of a residual."""
    score = sum(e.T @ part.features[:, group] for part, e in zip(parts, residual, strict=True))
    return int((np.asarray(score) ** 2).reshape(-1, len(group) // 2, 2).sum(axis=(0, 2)).argmax())


def family_p_values(gained: Sequence[Array], total: float) -> Array:
    """Family-wise p-value of each gain (1 + D,), the real one first and draws of the null behind.

    Each is measured by the mean of the highest twentieth of its own null, and the largest over all
    groups in each draw is what chance can do. total: squares of the residual.
    """
    table = np.stack(gained)
    null = np.sort(table[:, 1:], axis=1)
    middle = np.median(null, axis=1, keepdims=True)
    tail = null[:, -max(1, null.shape[1] // 20) :].mean(axis=1, keepdims=True)
    standard = (table - middle) / np.maximum(tail - middle, RELEVANT * total + 1e-300)
    largest = standard[:, 1:].max(axis=0)
    above = (largest[None, :] >= standard[:, :1]).sum(axis=1)
    return (1 + above) / (1 + null.shape[1])
