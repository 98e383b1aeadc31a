"""Where a model fails: the share of the force residual that each variable explains, held out.

Flexible functions of each variable are fitted to the filtered force residual, together with the
model's own columns, so that what its parameters could absorb is not counted. Each log in turn is
held out. The same computation on residuals with random signs, block by block, shows what chance
alone explains: see :mod:`identification.residual_map.bootstrap`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identification.fitting.harmonic_scan import harmonic_scan
from identification.fitting.regression import filtered_residual
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.residual_map.bootstrap import family_wise_p_values, random_signs
from identification.residual_map.curves import Curve, curves_of
from identification.residual_map.held_out_gain import (
    HeldOutGain,
    NuisanceRegressors,
    blocks_of,
    held_out_gains,
    model_held_out_square,
    residuals_after,
    right_hand_sides,
    standardised_gains,
    strongest_order,
)
from identification.residual_map.log_shares import log_shares
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import ResidualMap, Share
from identification.residual_map.table import ResidualTable, residual_table

Array = NDArray[np.float64]


def residual_map(
    mechanism: Mechanism,
    theta: Array,
    logs: Sequence[Samples],
    *,
    seed: int = 0,
    settings: ResidualMapSettings = ResidualMapSettings(),
    fit: FitSettings = FitSettings(),
) -> ResidualMap:
    """Map what a model leaves of the filtered forces onto the variables of the motion.

    Parameters
    ----------
    mechanism : with its effects
    theta : (P,) parameters at which the residual is taken; they are refitted in every step
    logs : the mechanism's samples of each log
    seed : of the random signs
    settings, fit : all numbers that the map depends on; of the fit's those of the filter and of
        cross-validation

    Notes
    -----
    Ridge regression, one strength for all logs. One log alone is held out in contiguous parts.
    Shares of different variables overlap: a force along the world's X axis depends on the heading
    and, in a small room, on the position too.
    """
    seconds = sum(samples.dt * len(samples) for samples in logs)
    if seconds < settings.min_duration:
        return ResidualMap((), seconds=seconds)
    table = residual_table(mechanism, np.asarray(theta, float), logs, settings, fit)
    folds = table.folds
    rng = np.random.default_rng(seed)
    signs = random_signs(rng, settings.bootstrap_draws, blocks_of(folds))
    # The twist first, since friction and inertia act through it; then every other variable beside
    # the twist, so that a variable that only moves with the twist gets no share.
    model_alone = NuisanceRegressors(np.zeros(0, np.intp), 0.0)
    residual = residuals_after(folds, model_alone)
    sides = right_hand_sides(folds, residual, signs)
    total = model_held_out_square(folds, sides)
    given = sum((fold.residual**2).sum() for fold in folds)
    twist, *others = table.groups
    groups = [(table.index[twist.variable], None)]
    (of_twist,) = held_out_gains(folds, sides, model_alone, groups, settings.ridge_strengths)
    ridge, twist_gain = of_twist.best
    with_twist = NuisanceRegressors(table.index[twist.variable], ridge)
    beyond = residuals_after(folds, with_twist)
    sides = right_hand_sides(folds, beyond, signs)
    groups = [
        (table.index[g.variable], settings.fitted_wheel_orders if g.pairs else None) for g in others
    ]
    rest = held_out_gains(folds, sides, with_twist, groups, settings.ridge_strengths)
    shares = _shares(table, [of_twist, *rest], twist_gain, total, signs.shape[1], beyond)
    own = _beyond_twist(log_shares(folds, table.variables, table.reductions, settings), shares)
    shares = _with_periods(shares, _beyond_twist(_periodic(mechanism, theta, logs, fit), shares))
    refit = 1.0 - total / given if given > 0 else 0.0
    shares = tuple(sorted([*shares, *own], key=lambda item: (-item.share, item.p_value)))
    return ResidualMap(shares, float(refit), seconds, partial(_curves, table, residual, beyond))


def _periodic(
    mechanism: Mechanism, theta: Array, logs: Sequence[Samples], fit: FitSettings
) -> list[Share]:
    """Shares of places by what repeats over them every few centimetres, where that is seen."""
    residual = [filtered_residual(mechanism, np.asarray(theta, float), item, fit) for item in logs]
    waves = harmonic_scan(mechanism, residual, logs, fit, angles=False)
    unit = "rad" if mechanism.variables(logs[0]).turns else "m"
    return [
        Share(wave.variable, wave.share, wave.p_value, period=wave.period, unit=unit)
        for wave in waves
        if wave.is_seen(fit.harmonic_scan)
    ]


def _with_periods(shares: Sequence[Share], periodic: Sequence[Share]) -> tuple[Share, ...]:
    """The shares, of places the larger of what they explain smoothly and by what repeats."""
    known = {item.variable: item for item in periodic}
    return tuple(
        max(item, known.get(item.variable, item), key=lambda share: share.share) for item in shares
    )


def _beyond_twist(own: Sequence[Share], shares: Sequence[Share]) -> list[Share]:
    """Shares of a scan of its own, no more than the twist leaves.

    A bend in the twist is another slope in each log, since each log has speeds of its own.
    """
    left = max(0.0, 1.0 - sum(item.share for item in shares if item.variable == "twist"))
    return [replace(item, share=min(item.share, left)) for item in own]


def _curves(
    table: ResidualTable,
    residual: Sequence[Array],
    beyond: Sequence[Array],
    share: Share,
) -> list[Curve]:
    """Over the twist: of the model's residual. Over others: of what the twist leaves of it.

    None over the log and the time that logs share: what differs there are parameters.
    """
    variable = share.variable
    if variable not in table.index:
        return []
    return curves_of(
        variable,
        table.variables,
        table.reductions,
        residual if variable == "twist" else beyond,
        block=table.folds[0].block,
        settings=table.settings,
        cycles=share.cycles or 1,
        period=share.period,
    )


def _shares(
    table: ResidualTable,
    gains: Sequence[HeldOutGain],
    twist_gain: float,
    total: float,
    blocks: int,
    beyond: Sequence[Array],
) -> tuple[Share, ...]:
    """Shares by variable, the largest first.

    Parameters
    ----------
    gains : of each group of the table, the twist's first; ``twist_gain``: with the ridge taken
    total : held-out squares of the residual, in ``blocks`` blocks
    beyond : residuals of each fold after the twist, which tell a wheel's order
    """
    settings = table.settings
    by_group = np.stack([gain.total for gain in gains])
    comparable = standardised_gains(
        by_group, total, settings.null_tail_share, settings.min_null_share_of_residual
    )
    p_values = family_wise_p_values(comparable[:, 0], comparable[:, 1:])
    # Gains of other variables count from the fit with the twist. If that predicts worse than no fit
    # (a negative gain), its loss is taken off their gains.
    loss = [0.0, *[min(twist_gain, 0.0)] * (len(gains) - 1)]
    # Few blocks allow few different sign patterns. Chance then explains the share of one block more
    # often than the draws show.
    least = total * max(settings.min_share_of_residual, 1.0 / blocks)
    shares = []
    for group, gain, lost, p_value in zip(table.groups, by_group, loss, p_values, strict=True):
        told = p_value <= settings.max_p_value and gain[0] + lost > least
        share = float((gain[0] + lost) / total) if told else 0.0
        cycles = None
        if group.pairs and told:
            cycles = 1 + strongest_order(table.folds, beyond, table.index[group.variable])
        shares.append(Share(group.variable, share, float(p_value), cycles))
    return tuple(sorted(shares, key=lambda item: (-item.share, item.p_value)))
