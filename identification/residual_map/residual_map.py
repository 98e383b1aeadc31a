"""Where a model fails: the share of the force residual that each variable explains, held out.

Flexible functions of each variable are fitted to the filtered force residual, together with the
model's own columns, so that what its parameters could absorb is not counted. Each log in turn is
held out. What chance alone explains is known from the same computation on residuals whose signs are
drawn at random, block by block (wild bootstrap: Liu, Annals of Statistics 16(4), 1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.residual_map.curves import Curve, curves_of
from identification.residual_map.features import ORDERS
from identification.residual_map.held_out_shares import (
    Nuisance,
    base_squares,
    draw_signs,
    family_p_values,
    gains,
    left_over,
    sides_of,
    strongest_order,
)
from identification.residual_map.table import ResidualTable, make_table

if TYPE_CHECKING:
    from identification.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]

LEVEL = 0.01
"""Family-wise: of a hundred maps of sound models one shows a share that chance made."""

LEAST = 0.01
"""Shares below this are not told: significance is not relevance.

Nor are those of less than one bootstrap block's worth of the residual, which with few blocks
chance reaches more often than the draws of their signs show."""

SHORTEST = 20.0
"""Seconds of logs below which nothing can be told."""


@dataclass(frozen=True)
class Share:
    """Held-out share of the residual's variance that a variable explains.

    share : beyond the twist, of the twist alone; 0 where chance could have made it
    p_value : family-wise, over all variables
    cycles : per turn, of a wheel's angle that has a share
    """

    variable: str
    share: float
    p_value: float
    cycles: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        found = {"variable": self.variable, "share": self.share, "p_value": self.p_value}
        return found if self.cycles is None else {**found, "cycles": self.cycles}


@dataclass(frozen=True)
class ResidualMap:
    """Result of :func:`residual_map`: shares, the largest first.

    refit : share of the given parameters' residual that disappears when they are fitted again,
        held out; it may be negative
    """

    shares: tuple[Share, ...]
    refit: float = 0.0
    _table: ResidualTable | None = field(default=None, repr=False, compare=False)
    _residual: tuple[tuple[Array, ...], ...] = field(default=(), repr=False, compare=False)

    def to_list(self) -> list[dict[str, Any]]:
        """JSON form, as the design fixes it."""
        return [share.to_dict() for share in self.shares]

    @property
    def leading(self) -> tuple[str, ...]:
        """Variables with a share, the largest first."""
        return tuple(share.variable for share in self.shares if share.share > 0)

    def curve(self, variable: str) -> list[Curve]:
        """The residual over a variable, for a plot: one curve, or one for each component of twist.

        Of what the model's parameters leave, and for other variables than the twist of what any
        function of the twist leaves; none where the logs were too short for a map.

        Raises
        ------
        KeyError
            If the logs have no such variable.
        """
        cycles = {share.variable: share.cycles for share in self.shares}[variable]
        if self._table is None:
            return []
        residual = self._residual[0 if variable == "twist" else 1]
        return curves_of(self._table, residual, variable, cycles or 1)


def residual_map(
    mechanism: Mechanism, theta: Array, logs: Sequence[Any], *, seed: int = 0
) -> ResidualMap:
    """Map what a model leaves of the filtered forces onto the variables of the motion.

    Parameters
    ----------
    mechanism : with its effects
    theta : (P,) parameters at which the residual is taken; they are refitted along in every step
    logs : the mechanism's samples of each log
    seed : of the random signs

    Notes
    -----
    Ridge regression, one strength for all logs. One log alone is held out in five contiguous
    blocks. Shares of different variables overlap: a force
    along the world's X axis depends on the heading and, in a small room, on the position too.
    """
    if sum(samples.dt * len(samples) for samples in logs) < SHORTEST:
        return ResidualMap(())
    table = make_table(mechanism, np.asarray(theta, float), logs)
    parts, signs = table.parts, draw_signs(table.parts, seed)
    twist, *others = table.groups
    bare = Nuisance(np.zeros(0, np.intp), 0.0)
    residual = left_over(parts, bare)
    sides = sides_of(parts, residual, signs)
    total, given = base_squares(parts, sides), sum((part.residual**2).sum() for part in parts)
    (first,) = gains(parts, sides, bare, [(table.index[twist.variable], False)])
    strength, gained = first.strength
    nuisance = Nuisance(table.index[twist.variable], strength)
    beyond = left_over(parts, nuisance)
    sides = sides_of(parts, beyond, signs)
    rest = gains(parts, sides, nuisance, [(table.index[g.variable], g.pairs) for g in others])
    explained = [gain.total for gain in (first, *rest)]
    p_values = family_p_values(explained, total)
    # Where a function of the twist predicts worse than none, "beyond it" starts from none.
    start = [0.0, *[min(gained, 0.0)] * len(rest)]
    least = total * max(LEAST, 1.0 / signs.shape[1])
    shares = []
    for group, gain, loss, p_value in zip(table.groups, explained, start, p_values, strict=True):
        told = p_value <= LEVEL and gain[0] + loss > least
        share = float((gain[0] + loss) / total) if told else 0.0
        cycles = None
        if group.pairs and told:
            cycles = int(ORDERS[strongest_order(parts, beyond, table.index[group.variable])])
        shares.append(Share(group.variable, share, float(p_value), cycles))
    shares.sort(key=lambda item: (-item.share, item.p_value))
    refit = 1.0 - total / given if given > 0 else 0.0
    return ResidualMap(tuple(shares), float(refit), table, (tuple(residual), tuple(beyond)))
