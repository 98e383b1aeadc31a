"""Is a residual linear in speeds and accelerations, by a law that changes at an instant? Held out.

A load that is put on, a drive that grows weak: what resists then follows the motion, in another way
before and after. Trees split at values and must learn a slope in steps, before and after each; of a
minute or two they learn nothing of it. Here one instant is chosen by most of the stretches of time,
with a law of its own before and after it, and predicts the others, fold by fold, so that chance has
nothing to gain by the many instants that were tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from identification.fitting.settings import ChangingLawSettings

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Rows:
    """Rows of all logs, one log after another.

    Attributes
    ----------
    residual : (n, A) of a model; columns : (n, A, F) of its parameters
    signals : (n, Q), speeds and accelerations
    time : (n,) [s] since the log's start; log : (n,) its number, from 0
    stretch : (n,) number of the stretch of time that is held out as one; fold : (n,) its fold
    """

    residual: Array
    columns: Array
    signals: Array
    time: Array
    log: Indices
    stretch: Indices
    fold: Indices


@dataclass(frozen=True)
class ChangingLaw:
    """What the best law predicts on stretches that were held out.

    Attributes
    ----------
    predicted : (n, A), each stretch from the others
    share : of the squares of the residual less its mean in each stretch, that this takes away;
        below zero of noise. An offset that wanders has next to nothing left there.
    p_value : chance of such a share
    """

    predicted: Array
    share: float
    p_value: float


def changing_law(rows: Rows, settings: ChangingLawSettings) -> ChangingLaw:
    """The best law of all that change at one instant, of each log's time or of one log alone.

    What is no such law has a share below zero. A law that does not change is one of them.
    """
    folds = np.unique(rows.fold)
    if len(folds) < 2:  # less than two stretches: nothing can be held out
        return ChangingLaw(np.zeros_like(rows.residual), 0.0, 1.0)
    size = np.maximum(rows.residual.std(axis=0), 1e-300)  # all axes weigh alike
    residual, refitted = _refitted(rows, size)
    scaled = rows.signals / np.maximum(rows.signals.std(axis=0), 1e-300)
    signals = _beside_means(scaled, rows.stretch)
    width = max(settings.instant_step, float(rows.time.max()) / settings.max_instants)
    at = (rows.time / width).astype(np.intp)
    gram, side = _sums(rows, signals, residual, at)
    laws = list(_laws(len(gram), at, width, settings))
    grams, sides = (np.stack([_within(part, law) for law in laws]) for part in (gram, side))
    gram, side = gram.sum(axis=(0, 1)), side.sum(axis=(0, 1))
    predicted, of_whole = np.zeros_like(residual), refitted
    for fold in folds:
        others = np.arange(len(gram)) != fold
        other_grams, other_sides = (part[:, others].sum(axis=1) for part in (grams, sides))
        whole = gram[others].sum(axis=0), side[others].sum(axis=0)
        best, strengths = _best(other_grams, other_sides, *whole, settings)
        held = np.flatnonzero(rows.fold == fold)
        log, first = laws[best]
        acts = (at[held] >= first) & ((rows.log[held] == log) | (log is None))
        strength = strengths[acts.astype(np.intp)]
        predicted[held] = np.einsum("nq,nqa->na", signals[held], strength)
        of_whole[held] += np.einsum("nq,nqa->na", scaled[held], strength)
    gains = (residual**2 - (residual - predicted) ** 2).sum(axis=1)
    # A law that acts in some stretches only gains in few of them: shorter parts are counted.
    _, part = np.unique(np.stack([rows.log, at]), axis=1, return_inverse=True)
    by_part = np.bincount(part.ravel(), gains)
    gain, spread = float(gains.sum()), float(by_part.std(ddof=1)) * np.sqrt(len(by_part))
    share = gain / max(float((residual**2).sum()), 1e-300)
    return ChangingLaw(of_whole * size, share, float(ndtr(-gain / max(spread, 1e-300))))


def _best(
    grams: Array, sides: Array, gram: Array, side: Array, settings: ChangingLawSettings
) -> tuple[int, Array]:
    """Number of the law that explains the most, and its strengths (2, Q, A): where it is not
    another law, and where it is.

    Parameters
    ----------
    grams : (laws, Q, Q) products of the signals where each law is another; gram : (Q, Q) in all
    sides : (laws, Q, A), side : (Q, A), the same of signals and residual
    """
    little = settings.ridge * np.trace(gram) / len(gram) * np.eye(len(gram))
    inside = np.linalg.solve(grams + little, sides)
    outside = np.linalg.solve(gram - grams + little, side - sides)
    gain = (inside * sides + outside * (side - sides)).sum(axis=(1, 2))
    best = int(gain.argmax())
    return best, np.stack([outside[best], inside[best]])


def _refitted(rows: Rows, size: Array) -> tuple[Array, Array]:
    """(n, A) residual over ``size`` (A,) less its mean in each stretch and what a change of the
    model's parameters takes of that; and this change without any mean taken off.

    An offset that wanders shifts the parameters of a model that does not know it, and these follow
    the motion. Beside the means they are as they were.
    """
    residual = _beside_means(rows.residual / size, rows.stretch)
    n, axes, count = rows.columns.shape
    whole = rows.columns / size[:, None]
    whole = whole / np.maximum(np.sqrt((whole**2).mean(axis=(0, 1))), 1e-300)
    beside = _beside_means(whole.reshape(n, axes * count), rows.stretch)
    change = np.linalg.pinv(beside.reshape(n * axes, count), rcond=1e-6) @ residual.ravel()
    return residual - beside.reshape(n, axes, count) @ change, whole @ change


Law = tuple[int | None, int]
"""The log in which it is another law, None: all, and the first step of time in which it is."""


def _laws(logs: int, at: Indices, width: float, settings: ChangingLawSettings) -> Iterator[Law]:
    """None that changes; then each log and all of them, from each instant on."""
    yield None, 0
    least = -(-settings.min_duration // width)
    last = int(at.max(initial=0)) + 1 - least
    for log in [None, *range(logs)] if logs > 1 else [None]:
        if log is not None:
            yield log, 0
        yield from ((log, first) for first in range(int(least), int(last) + 1))


def _sums(rows: Rows, signals: Array, residual: Array, at: Indices) -> tuple[Array, Array]:
    """Products (logs, steps of time, folds, Q, Q or A) of signals, and of these and the residual,
    over the rows of each log, step of time and fold."""
    shape = int(rows.log.max(initial=0)) + 1, int(at.max(initial=0)) + 1, int(rows.fold.max()) + 1
    place = np.ravel_multi_index((rows.log, at, rows.fold), shape)
    both = np.concatenate([signals, residual], axis=1)
    count, found = signals.shape[1], np.zeros((int(np.prod(shape)), *both.shape[1:] * 2))
    found = found[:, :count]
    for first, second in np.ndindex(*found.shape[1:]):
        product = signals[:, first] * both[:, second]
        found[:, first, second] = np.bincount(place, product, len(found))
    found = found.reshape(*shape, *found.shape[1:])
    return found[..., :count], found[..., count:]


def _within(sums: Array, law: Law) -> Array:
    """(folds, ...) sums over the rows in which it is another law."""
    log, first = law
    chosen = sums if log is None else sums[log : log + 1]
    return chosen[:, first:].sum(axis=(0, 1))


def _beside_means(values: Array, stretch: Indices) -> Array:
    """(n, C) values less their mean in each stretch of time."""
    counts, found = np.maximum(np.bincount(stretch), 1), values.copy()
    for k, column in enumerate(values.T):
        found[:, k] -= (np.bincount(stretch, column) / counts)[stretch]
    return found
