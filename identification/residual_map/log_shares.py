"""Shares of a residual that the log, or the time that all logs share, explains.

A log that is held out cannot tell what is its own. So here stretches of every log are held out in
turn, and the model's parameters, with a constant force along the body's axes and the world's, may
differ from log to log, or change steadily over all logs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from identification.residual_map.held_out_gain import FoldRows
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import Share
from identification.residual_map.variables import MotionVariables
from identification.signals.filters import RowFilter

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def log_shares(
    folds: Sequence[FoldRows],
    variables: Sequence[MotionVariables],
    reductions: Sequence[RowFilter],
    settings: ResidualMapSettings,
) -> tuple[Share, ...]:
    """Shares of "log" and "shared_time", in this order; () for a log alone.

    Parameters
    ----------
    folds : one a log; variables, reductions : of each log
    """
    if len(folds) < 2 or len(folds) != len(variables):
        return ()
    design = [
        np.concatenate([fold.columns, _constant_forces(one, reduction, fold)], axis=-1)
        for fold, one, reduction in zip(folds, variables, reductions, strict=True)
    ]
    size = design[0].shape[-1]
    total = sum(len(fold.residual) for fold in folds)
    found, start = [], 0
    ways: dict[str, list[Array]] = {"log": [], "shared_time": []}
    for k, one in enumerate(design):
        own = np.zeros((*one.shape[:2], size * len(folds)))
        own[..., k * size : (k + 1) * size] = one
        ways["log"].append(own)
        # From -1 to 1 over all logs, one after the other.
        when = 2.0 * (start + np.arange(len(one))) / total - 1.0
        ways["shared_time"].append(np.concatenate([one, one * when[:, None, None]], axis=-1))
        start += len(one)
    residual = [fold.residual for fold in folds]
    stretches = [
        np.arange(len(fold.residual)) // max(1, round(settings.log_stretch / reduction.step))
        for fold, reduction in zip(folds, reductions, strict=True)
    ]
    before = _held_out(design, residual, stretches)
    # As of all other variables: a share of what the model's own parameters leave.
    model = _held_out([fold.columns for fold in folds], residual, stretches)
    whole = sum(float(part.sum()) for part in model)
    for name, way in ways.items():
        after = _held_out(way, residual, stretches)
        found.append(_share(name, before, after, whole, stretches, settings))
    return tuple(found)


def _constant_forces(one: MotionVariables, reduction: RowFilter, fold: FoldRows) -> Array:
    """(n, A, C) columns of constant forces along the body's axes, and along the world's."""
    rows, axes = fold.residual.shape
    body = np.broadcast_to(np.eye(axes), (rows, axes, axes))
    if one.heading is None or axes < 2:
        return body
    heading = np.column_stack([np.cos(one.heading), np.sin(one.heading)])
    waves = reduction.of_samples(heading)[:rows]
    world = np.zeros((rows, axes, 2))
    world[:, 0, 0], world[:, 1, 0] = waves[:, 0], -waves[:, 1]
    world[:, 0, 1], world[:, 1, 1] = waves[:, 1], waves[:, 0]
    return np.concatenate([body, world], axis=-1)


def _held_out(
    design: Sequence[Array], residual: Sequence[Array], stretches: Sequence[Indices]
) -> list[Array]:
    """Per log (n,) squares of each row, fitted to the other half of the stretches."""
    size = design[0].shape[-1]
    halves = [stretch % 2 for stretch in stretches]
    left = [np.zeros(len(part)) for part in residual]
    for half in (0, 1):
        gram, side = np.zeros((size, size)), np.zeros(size)
        for columns, part, which in zip(design, residual, halves, strict=True):
            known = columns[which != half].reshape(-1, size)
            gram += known.T @ known
            side += known.T @ part[which != half].ravel()
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        # 1e-6 of the diagonal: a log may not show a parameter at all.
        scaled = gram / np.outer(scale, scale) + 1e-6 * np.eye(size)
        theta = np.linalg.solve(scaled, side / scale) / scale
        for columns, part, which, out in zip(design, residual, halves, left, strict=True):
            held = which == half
            out[held] = ((part[held] - columns[held] @ theta) ** 2).sum(axis=1)
    return left


def _share(
    name: str,
    before: Sequence[Array],
    after: Sequence[Array],
    whole: float,
    stretches: Sequence[Indices],
    settings: ResidualMapSettings,
) -> Share:
    """The share of the squares that is explained, if stretches say so that were held out."""
    gains = np.concatenate(
        [
            np.bincount(stretch, a - b)
            for a, b, stretch in zip(before, after, stretches, strict=True)
        ]
    )
    spread = float(gains.std(ddof=1)) * np.sqrt(len(gains)) if len(gains) > 1 else np.inf
    gain = float(gains.sum())
    p_value = float(ndtr(-gain / max(spread, 1e-300)))
    share = gain / max(whole, 1e-300)
    told = p_value <= settings.max_p_value and share > settings.min_log_share
    return Share(name, share if told else 0.0, p_value)
