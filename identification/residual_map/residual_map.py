"""Where a model fails: the share of the force residual that each variable explains, held out.

Flexible functions of each variable are fitted to the filtered force residual, together with the
model's own columns, so that what its parameters could absorb is not counted. Each log in turn is
held out; for the pose and the time, which may lie elsewhere in each log, stretches of all logs too,
since what was learnt of one place says nothing of another. The larger share counts. The same
computation on residuals with random signs, block by block, shows what chance alone explains: see
:mod:`identification.residual_map.bootstrap`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.fitting.harmonic_scan import harmonic_scan
from identification.fitting.parts import give_back_after
from identification.fitting.regression import filtered_residual
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples, cut
from identification.residual_map.bootstrap import family_wise_p_values, random_signs
from identification.residual_map.curves import Curve, curves_of
from identification.residual_map.features import FeatureGroup
from identification.residual_map.held_out_gain import (
    FoldRows,
    Held,
    HeldOutGain,
    NuisanceRegressors,
    RightHandSides,
    Sums,
    held_out_gains,
    model_held_out_square,
    residuals_after,
    right_hand_sides,
    standardised_gains,
    strongest_order,
    unshrunk_residuals,
)
from identification.residual_map.log_shares import log_shares
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import ResidualMap, Share
from identification.residual_map.table import ResidualTable, residual_table
from identification.residual_map.variables import MotionVariables
from identification.signals.filters import RowFilter

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


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
    # First, while no table is there: it reads all samples.
    periodic = _periodic(mechanism, theta, logs, fit)
    give_back_after(logs, fit)
    table = residual_table(mechanism, np.asarray(theta, float), logs, settings, fit)
    rows = _DealtRows(table)
    rng = np.random.default_rng(seed)
    signs = random_signs(rng, settings.bootstrap_draws, rows.blocks)
    # The twist first, since friction and inertia act through it; then every other variable beside
    # the twist, so that a variable that only moves with the twist gets no share.
    model_alone = NuisanceRegressors(np.zeros(0, np.intp), 0.0)
    residual = rows.after(model_alone)
    given = sum((fold.residual**2).sum() for fold in table.folds)
    twist, *others = table.groups
    ways = rows.held_out(rows.noise(residual, model_alone), signs)
    squares = rows.squares(ways)
    groups = [(table.index[twist.variable], None)]
    of_twist = [
        held_out_gains(parts, model_alone, groups, settings.ridge_strengths)[0] for parts in ways
    ]
    chosen = [group for group in others if group.follows_twist]
    alone = list(_gains(table, ways[0], model_alone, chosen))
    del ways  # their draws take as much memory as those that are judged beside the twist
    ridge, _ = of_twist[0].best
    with_twist = NuisanceRegressors(table.index[twist.variable], ridge)
    beyond = rows.after(with_twist)
    # Few blocks allow few different sign patterns. Chance then explains the share of one block more
    # often than the draws show.
    least = max(settings.min_share_of_residual, 1.0 / signs.shape[1])
    judged = [_Judged(twist, of_twist[0], 0.0, squares[0], least)]
    for k, parts in enumerate(rows.held_out(rows.noise(beyond, with_twist), signs)):
        chosen = [group for group in others if k == 0 or group.may_lie_elsewhere]
        # Gains count from the fit with the twist. If that predicts worse than no fit (a negative
        # gain), its loss is taken off them.
        loss = min(of_twist[k].at(ridge), 0.0)
        enough = max(least, settings.min_stretch_share) if k else least
        gains = _gains(table, parts, with_twist, chosen)
        judged += [_Judged(g, gain, loss, squares[k], enough) for g, gain in gains]
    by_itself = [_Judged(g, gain, 0.0, squares[0], least) for g, gain in alone]
    shares = _with_parts_of_twist(
        _shares(table, judged, beyond), _shares(table, by_itself, residual)
    )
    own = _beyond_twist(
        log_shares(table.folds, table.variables, table.reductions, settings), shares
    )
    shares = _with_periods(shares, _beyond_twist(periodic, shares))
    refit = 1.0 - squares[0] / given if given > 0 else 0.0
    shares = tuple(sorted([*shares, *own], key=lambda item: item.order))
    return ResidualMap(shares, float(refit), seconds, _CurvesOfMap.of(table, residual, beyond))


def _periodic(
    mechanism: Mechanism, theta: Array, logs: Sequence[Samples], fit: FitSettings
) -> list[Share]:
    """Shares of places by what repeats over them every few centimetres, where that is seen."""
    residual = [filtered_residual(mechanism, np.asarray(theta, float), item, fit) for item in logs]
    waves = harmonic_scan(mechanism, residual, logs, fit, angles=False)
    place = "rad" if mechanism.variables(cut(logs[0], 0, 2)).turns else "m"
    return [
        Share(
            *(wave.variable, wave.share, wave.p_value),
            period=wave.period,
            unit="s" if wave.variable == "time" else place,
        )
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


@dataclass(frozen=True)
class _CurvesOfMap:
    """Curves of a map. It keeps what they show, and none of the features.

    index : places of each variable's features
    residual, beyond : (n, A) of each fold, of the model, and what the twist leaves of it
    block : rows within which residuals are correlated
    """

    index: Mapping[str, Indices]
    variables: tuple[MotionVariables, ...]
    reductions: tuple[RowFilter, ...]
    residual: Sequence[Array]
    beyond: Sequence[Array]
    block: int
    settings: ResidualMapSettings

    @classmethod
    def of(
        cls, table: ResidualTable, residual: Sequence[Array], beyond: Sequence[Array]
    ) -> _CurvesOfMap:
        """Of a table."""
        variables = tuple(one.for_curves() for one in table.variables)
        block, settings = table.folds[0].block, table.settings
        return cls(table.index, variables, table.reductions, residual, beyond, block, settings)

    def __call__(self, share: Share) -> list[Curve]:
        """Over the twist: of the model's residual. Over others: of what the twist leaves of it.

        None over the log and the time that logs share: what differs there are parameters.
        """
        variable = share.variable
        if variable not in self.index:
            return []
        return curves_of(
            variable,
            self.variables,
            self.reductions,
            self.residual if variable == "twist" else self.beyond,
            block=self.block,
            settings=self.settings,
            cycles=share.cycles or 1,
            period=share.period,
        )


class _Cell(NamedTuple):
    """Rows of one fold of a table: those of one stretch in so many, by its turn.

    blocks : which of the blocks of all cells, whose signs are drawn together, are its own
    """

    fold: int
    turn: int
    rows: Indices
    blocks: slice

    @property
    def owners(self) -> tuple[int, int]:
        """With what it is held out in either way: its fold, and its turn."""
        return self.fold, self.turn


class _DealtRows:
    """The rows of a table, dealt into cells, whose sums make both ways of holding out.

    One cell after another is copied out of the table: all at once would be the table once more.
    """

    def __init__(self, table: ResidualTable) -> None:
        self.table, self._cells = table, list(_cells_of(table))
        *self._matrices, (self.total,) = self._summed(lambda cell: self._taken(cell).matrices)

    @property
    def blocks(self) -> int:
        """Blocks of all cells."""
        return self._cells[-1].blocks.stop

    def _taken(self, cell: _Cell) -> FoldRows:
        return self.table.folds[cell.fold].taken(cell.rows)

    def _summed(self, of_cell: Callable[[_Cell], Sums]) -> list[list[Sums]]:
        """Sums over the cells of each fold, over those of each turn, and over all of them."""
        found: list[dict[int, Sums]] = [{}, {}, {}]
        for cell in self._cells:
            one = of_cell(cell)
            for sums, owner in zip(found, (*cell.owners, 0), strict=True):
                sums[owner] = sums[owner] + one if owner in sums else one
        return [[sums[owner] for owner in sorted(sums)] for sums in found]

    def after(self, nuisance: NuisanceRegressors) -> list[Array]:
        """Residuals (n, A) of each fold of the table after a fit of the nuisance to all rows."""
        return residuals_after(self.table.folds, self.total, nuisance)

    def noise(self, residual: Sequence[Array], nuisance: NuisanceRegressors) -> list[Array]:
        """These residuals, as large as the noise is of which the fit has taken a part."""
        return unshrunk_residuals(self.table.folds, residual, self.total, nuisance)

    def held_out(self, null: Sequence[Array], signs: Array) -> list[list[Held]]:
        """What is held out together: each of the table's folds, and then stretches of all.

        Parameters
        ----------
        null : of each fold of the table (n, A); signs : (draws, blocks of all cells)
        """

        def sides(cell: _Cell) -> RightHandSides:
            of_cell = null[cell.fold][cell.rows]
            return right_hand_sides(self._taken(cell), of_cell, signs[:, cell.blocks])

        *found, _ = self._summed(sides)
        ways = zip(self._matrices, found, strict=True)
        return [[Held(*part) for part in zip(*way, strict=True)] for way in ways]

    def squares(self, ways: Sequence[Sequence[Held]]) -> list[float]:
        """Of each way: held-out squares of the residual with the model's own parameters alone."""
        found = []
        for way, parts in enumerate(ways):
            rows = [self._rows_of(way, k) for k in range(len(parts))]
            found.append(model_held_out_square(parts, *zip(*rows, strict=True)))
        return found

    def _rows_of(self, way: int, part: int) -> tuple[Array, Array]:
        """Residual (n, A) and columns (n, A, P) of what is held out together."""
        owner = sorted({cell.owners[way] for cell in self._cells})[part]
        own = [(self.table.folds[c.fold], c.rows) for c in self._cells if c.owners[way] == owner]
        return (
            np.concatenate([fold.residual[rows] for fold, rows in own]),
            np.concatenate([fold.columns[rows] for fold, rows in own]),
        )


def _cells_of(table: ResidualTable) -> Iterator[_Cell]:
    settings, first, start = table.settings, 0, 0
    step = table.reductions[0].step
    # Whole blocks, whose signs are drawn together.
    block = table.folds[0].block
    size = block * max(1, round(settings.log_stretch / (step * block)))
    for k, fold in enumerate(table.folds):
        stretch = first + np.arange(len(fold.residual)) // size
        first = int(stretch[-1]) + 1
        for turn in range(settings.stretch_folds):
            rows = np.flatnonzero(stretch % settings.stretch_folds == turn)
            if len(rows):
                stop = start + -(-len(rows) // fold.block)
                yield _Cell(k, turn, rows, slice(start, stop))
                start = stop


@dataclass(frozen=True)
class _Judged:
    """What a group explains in one way of holding out.

    loss : of the fit beside which it is judged; total : held-out squares of the residual
    least : share of them that is told
    """

    group: FeatureGroup
    gain: HeldOutGain
    loss: float
    total: float
    least: float


def _gains(
    table: ResidualTable,
    parts: Sequence[Held],
    beside: NuisanceRegressors,
    groups: Sequence[FeatureGroup],
) -> Iterator[tuple[FeatureGroup, HeldOutGain]]:
    """What each of some groups explains of what is held out."""
    orders = table.settings.fitted_wheel_orders
    chosen = [(table.index[g.variable], orders if g.pairs else None) for g in groups]
    return zip(
        groups, held_out_gains(parts, beside, chosen, table.settings.ridge_strengths), strict=True
    )


def _shares(
    table: ResidualTable, judged: Sequence[_Judged], beyond: Sequence[Array]
) -> tuple[Share, ...]:
    """Shares by variable, the largest first; of one that is judged twice, the larger.

    Parameters
    ----------
    beyond : residuals of each fold after the twist, which tell a wheel's order
    """
    settings = table.settings
    comparable = np.stack(
        [
            standardised_gains(
                one.gain.total[None],
                one.total,
                settings.null_tail_share,
                settings.min_null_share_of_residual,
            )[0]
            for one in judged
        ]
    )
    p_values = family_wise_p_values(comparable[:, 0], comparable[:, 1:])
    found: dict[str, Share] = {}
    for one, p_value in zip(judged, p_values, strict=True):
        name, gain = one.group.variable, float(one.gain.total[0] + one.loss)
        likely = gain > one.least * one.total and p_value <= settings.max_p_value_with_a_law
        told = likely and p_value <= settings.max_p_value
        cycles = None
        if one.group.pairs and told:
            order = strongest_order(table.folds, beyond, table.index[name])
            cycles = 1 + order % settings.max_wheel_order
        size = gain / one.total if likely else 0.0
        share = Share(name, size if told else 0.0, float(p_value), cycles, likely=size)
        found[name] = _both(found[name], share) if name in found else share
    return tuple(sorted(found.values(), key=lambda item: item.order))


def _both(one: Share, other: Share) -> Share:
    """Of a variable that is held out in two ways: that it matters, from where this is surest.

    How much it explains, from where that is most: the p-values of both are of one family.
    """
    surest, largest = min(one, other, key=_surest), max(one.likely, other.likely)
    told = one.share > 0.0 or other.share > 0.0
    return replace(surest, share=largest if told else 0.0, likely=largest)


def _surest(share: Share) -> tuple[bool, float, float]:
    return share.share == 0.0, share.p_value, -share.likely


def _with_parts_of_twist(shares: Sequence[Share], alone: Sequence[Share]) -> tuple[Share, ...]:
    """The shares with what variables that the twist determines explain by themselves.

    Beyond the twist a wheel's speed explains nothing; but it may be all that matters of the twist.
    """
    known = {item.variable: item.share for item in alone}
    return tuple(replace(item, alone=known.get(item.variable, 0.0)) for item in shares)
