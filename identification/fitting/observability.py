"""Which parameters a motion shows: Gramian, rank, blind directions and blocks, as in the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_directions
from identification.fitting.regression import Indices, Regression, covariance_of
from identification.fitting.settings import FitSettings
from identification.logs.logger_checks import moving
from identification.mechanisms.mechanism import FitResult, Mechanism
from identification.mechanisms.samples import Samples
from identification.signals.noise import white_noise
from youbot_env.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observability:
    """What one motion (or all together) shows of the parameters x, scaled as in the paper.

    Attributes
    ----------
    names : (F,) parameter names
    gramian : (F, F) integral of H^T H over time [s]
    rank : number of directions that are seen
    blind : (F - rank, F) unit vectors in x that are not seen
    blocks : names of parameters that can be estimated apart from the others
    least : smallest eigenvalue of the Gramian of unit columns
    """

    names: tuple[str, ...]
    gramian: Array
    rank: int
    blind: Array
    blocks: tuple[tuple[str, ...], ...]
    least: float

    def describe_blind(self, cutoff: float = FitSettings.min_direction_share) -> list[str]:
        """Each blind direction as a sum of parameters, such as ``x1 + x2 + x5``."""
        return [_combination(direction, cutoff) for direction in self.blind]

    def to_dict(self, cutoff: float = FitSettings.min_direction_share) -> dict[str, Any]:
        """JSON form: what is seen, what is blind in words, and what can be told apart."""
        return {
            "names": list(self.names),
            "rank": self.rank,
            "blind": self.describe_blind(cutoff),
            "blocks": [list(block) for block in self.blocks],
        }


def _combination(direction: Array, cutoff: float) -> str:
    largest = np.abs(direction).max()
    # The sign of an eigenvector is arbitrary: the first large term is made positive.
    direction = direction * np.sign(direction[np.argmax(np.abs(direction) > 0.5 * largest)])
    terms = []
    for k in np.flatnonzero(np.abs(direction) > cutoff * largest):
        share = direction[k] / largest
        factor = "" if abs(abs(share) - 1) < 0.1 else f"{abs(share):.1f} "
        sign = "-" if share < 0 else ("+" if terms else "")
        terms.append(f"{sign} {factor}x{k + 1}" if terms else f"{sign}{factor}x{k + 1}")
    return " ".join(terms)


def observability(
    names: Sequence[str],
    columns: Array,
    dt: float,
    gauge: Array | None = None,
    *,
    blind: float = FitSettings.blind_eigenvalue,
    settings: FitSettings = FitSettings(),
) -> Observability:
    """From regressor columns (n, A, F) in paper units, rows ``dt`` [s] apart.

    Parameters
    ----------
    gauge : (k, F) unit vectors that are settled by convention (the mean of gains), not by data
    blind : eigenvalue of the normalised Gramian under which a direction is not seen
    """
    flat = columns.reshape(-1, columns.shape[-1])
    gramian = flat.T @ flat * dt
    if gauge is not None:
        # A direction that a convention fixes counts as seen. Its weight is the largest diagonal
        # element, so that it is not small beside the data.
        gramian = gramian + gauge.T @ gauge * np.diag(gramian).max()
    norm = np.sqrt(np.diag(gramian))
    # Noise alone gives every column some length. Scaling such a short column to unit length would
    # make noise look like information.
    # Without any rows all are zero: nothing is seen.
    norm = np.maximum(norm, max(settings.min_column_share * norm.max(), 1e-100))
    unit = gramian / np.outer(norm, norm)
    values, vectors = np.linalg.eigh(unit)
    unseen = values < blind
    # Back from columns of unit length to the parameters x.
    directions = _orthonormal(vectors[:, unseen] / norm[:, None])
    rank = int(len(names) - unseen.sum())
    blocks = _blocks(names, unit, settings.min_coupling)
    least = float(values[0])
    return Observability(tuple(names), gramian, rank, directions, blocks, least)


def _orthonormal(directions: Array) -> Array:
    """Unit vectors (k, F) that span the columns (F, k), made sparse by Gauss-Jordan elimination.

    Sparse vectors can be read as sums such as x1 + x2. They need not be orthogonal.
    """
    if directions.shape[1] == 0:
        return directions.T
    rows = directions.T.copy()
    for k in range(len(rows)):
        pivot = np.unravel_index(np.argmax(np.abs(rows[k:])), rows[k:].shape)
        rows[[k, k + pivot[0]]] = rows[[k + pivot[0], k]]
        rows[k] /= rows[k, pivot[1]]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot[1]] * rows[k]
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _blocks(names: Sequence[str], unit: Array, coupling: float) -> tuple[tuple[str, ...], ...]:
    """Connected groups of parameters whose columns' cosines exceed ``coupling``."""
    # The diagonal is below 1 for a column that is too short (see `min_column_share`): noise, which
    # belongs to no block.
    left = [k for k in range(len(names)) if unit[k, k] > 0.5]
    blocks = []
    while left:
        block, frontier = set(), [left[0]]
        while frontier:
            k = frontier.pop()
            block.add(k)
            frontier += [j for j in left if j not in block and abs(unit[k, j]) > coupling]
        left = [k for k in left if k not in block]
        blocks.append(tuple(names[k] for k in sorted(block)))
    return tuple(blocks)


def log_observability(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    settings: FitSettings = FitSettings(),
) -> Observability:
    """What one log (or several together) shows of the parameters, from its regression rows."""
    order = mechanism.order
    names = [mechanism.parameter_names[k] for k in order]
    columns = np.concatenate([item.columns for item in rows])[..., _places(mechanism)]
    gauge = np.zeros((0, len(order)))
    for members, unseen in gauge_directions(mechanism):
        among = np.zeros(len(order))
        among[members] = unseen
        gauge = np.vstack([gauge, among[_places(mechanism)]])
    scaled = columns / mechanism.scale[order]
    blind = settings.blind_eigenvalue
    # The step only scales the Gramian; rank and blocks come from the normalised one.
    return observability(names, scaled, rows[0].step, gauge, blind=blind, settings=settings)


def in_motion(samples: Samples, rows: Regression) -> Regression:
    """The rows in which some joint moves.

    A joint that stands still shows no friction, whatever its noise or its counts say: what holds it
    may be anything up to the dry friction.
    """
    noise = white_noise(samples.wheel_speed)
    moves = moving(samples.wheel_speed, noise).any(axis=1)
    known = np.concatenate([[0], np.cumsum(moves)])
    ends = np.clip(np.round(rows.time / samples.dt).astype(int) + 1, 0, len(samples))
    starts = np.clip(
        np.round((rows.time - rows.step) / samples.dt).astype(int) + 1, 0, len(samples)
    )
    # Most of the row: a row at the edge of a standstill is half of it.
    kept = 2 * (known[ends] - known[starts]) > ends - starts
    return replace(
        rows, time=rows.time[kept], residual=rows.residual[kept], columns=rows.columns[kept]
    )


def told_apart_at_rest(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    rows: Sequence[Regression],
    total: Observability,
    settings: FitSettings = FitSettings(),
) -> Observability | None:
    """What motion alone shows, where it shows less than ``total`` does with the standstill."""
    moved = [in_motion(item, row) for item, row in zip(logs, rows, strict=True)]
    if all(len(some.time) == len(row.time) for some, row in zip(moved, rows, strict=True)):
        return None
    seen = log_observability(mechanism, moved, settings)
    return seen if seen.rank < total.rank else None


def refuse_blind(
    mechanism: Mechanism, seen: Observability, settings: FitSettings = FitSettings()
) -> None:
    """Raise InputError if some direction is not seen at all: with the motion that would show it.

    A direction that is hardly seen is fitted; its interval says how well.
    """
    if seen.rank == len(seen.names) or seen.least >= settings.refused_eigenvalue:
        return
    direction, least = seen.blind[0], settings.min_direction_share
    raise InputError(
        f"these logs cannot show {seen.describe_blind(least)[0]} "
        f"({', '.join(seen.names[k] for k in np.flatnonzero(np.abs(direction) > least))}): "
        f"{mechanism.advice(direction)}"
    )


def combinations(
    mechanism: Mechanism,
    fitted: FitResult,
    settings: FitSettings = FitSettings(),
) -> dict[str, tuple[float, float, str]]:
    """Sums of parameters that are known much better than their members: value, std and unit.

    Only where a member is not well known. Example: without steady turning and fast rolling apart,
    only m0 + 4 I1/R^2 resists an acceleration that the logs show.
    """
    names = [mechanism.parameter_names[k] for k in fitted.free]
    values = fitted.theta[fitted.free]
    found = {}
    for sum_name, factors in mechanism.conventions.combinations(mechanism.geometry).items():
        if not set(factors) <= set(names):
            continue
        weights = np.array([factors.get(name, 0.0) for name in names])
        members = np.flatnonzero(weights)
        value = float(weights @ values)
        std = float(np.sqrt(max(weights @ fitted.covariance @ weights, 0.0)))
        own = fitted.std[members] / np.maximum(np.abs(values[members]), 1e-300)
        better = std * settings.min_combination_gain < own.min() * abs(value)
        if better and own.max() > settings.max_separate_share:
            unit = mechanism.labels[fitted.free[members[0]]].parameter.unit
            found[sum_name] = (value, std, unit)
    return found


def _places(mechanism: Mechanism) -> Indices:
    """Places of the mechanism's order among the free parameters."""
    return np.searchsorted(np.flatnonzero(mechanism.free), mechanism.order)


def block_estimates(
    mechanism: Mechanism,
    theta: Array,
    rows: Regression,
    seen: Observability,
    settings: FitSettings = FitSettings(),
) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter whose block a motion shows whole.

    In an ideal motion the columns of different blocks are orthogonal, so a blind direction of
    another block does not matter. A driven motion deviates from the ideal one, and the columns are
    only nearly orthogonal. So all parameters are estimated together, and only those of blocks
    without a blind direction are reported. ``theta`` (P,): the parameters at which ``rows`` were
    computed.
    """
    order, places = mechanism.order, _places(mechanism)
    scale = mechanism.scale[order]
    columns = rows.columns[..., places]
    measured = rows.residual + columns @ theta[order]
    flat = (columns / scale).reshape(-1, len(order))
    x = np.linalg.lstsq(flat, measured.ravel(), rcond=settings.min_singular_value_share)[0]
    left = replace(rows, residual=measured - columns @ (x / scale), columns=columns)
    covariance = covariance_of([left], np.eye(len(order)), scale, settings)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = {}
    for block in seen.blocks:
        members = [seen.names.index(name) for name in block]
        hidden = (np.abs(direction[members]).max() for direction in seen.blind)
        if not any(share > settings.min_direction_share for share in hidden):
            found |= {seen.names[k]: (float(x[k] / scale[k]), float(std[k])) for k in members}
    return found
