"""Shares of a residual by variable: the result of a residual map."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any

from identification.residual_map.curves import Curve
from identification.residual_map.settings import ResidualMapSettings
from youbot_env.physics.effect import with_unit


@dataclass(frozen=True)
class Share:
    """Held-out share of the residual's variance that a variable explains.

    share : beyond the twist, of the twist alone; 0 where chance could have made it
    p_value : family-wise, over all variables
    cycles : per turn, of a wheel's angle that has a share
    alone : what it explains if the twist is left out, of what the twist determines: a wheel's
        speed may be all that matters of it
    likely : the share, also where chance could have made it in some per cent of cases
    period : after which it repeats, of a place that has its share by that, in ``unit``
    """

    variable: str
    share: float
    p_value: float
    cycles: int | None = None
    period: float | None = None
    unit: str = ""
    alone: float = 0.0
    likely: float = 0.0

    @property
    def order(self) -> tuple[float, float, float]:
        """The largest first; of those with none, what explains most if the twist is left out."""
        return -self.share, -self.alone, self.p_value

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        known = {"cycles": self.cycles, "period": self.period, "alone": self.alone or None}
        return {
            "variable": self.variable,
            "share": self.share,
            "p_value": self.p_value,
            **{name: value for name, value in known.items() if value is not None},
        }

    @property
    def words(self) -> str:
        """The variable with its share, and its period if it has one."""
        # Three digits: a scan over a room tells a period to a part in a hundred or better.
        often = ""
        if self.period is not None:
            often = f", again every {with_unit(f'{self.period:.3g}', self.unit)}"
        return f"{self.variable} ({self.share:.0%}{often})"


@dataclass(frozen=True)
class ResidualMap:
    """Result of :func:`residual_map`: shares, the largest first.

    seconds : of the logs that it was made of
    refit : share of the given parameters' residual that disappears when they are fitted again,
        held out; it may be negative
    _curves : of a variable with its share; None where the logs were too short
    """

    shares: tuple[Share, ...]
    refit: float = 0.0
    seconds: float = 0.0
    _curves: Callable[[Share], list[Curve]] | None = field(default=None, repr=False, compare=False)

    def to_list(self) -> list[dict[str, Any]]:
        """JSON form, as the design fixes it."""
        return [share.to_dict() for share in self.shares]

    def led_by(self, variables: Collection[str]) -> ResidualMap:
        """The same with what a rule or a law says of some variables.

        They come before all others of their share, and so lead those that have none: a patch of
        floor is met for some seconds in all. What is likely of them is told: there is a second
        evidence for it.
        """

        def named(item: Share) -> bool:
            return any(item.variable.startswith(name) for name in variables)

        told = [
            replace(item, share=max(item.share, item.likely)) if named(item) else item
            for item in self.shares
        ]
        return replace(
            self, shares=tuple(sorted(told, key=lambda item: (-item.share, not named(item))))
        )

    @property
    def leading(self) -> tuple[str, ...]:
        """Variables with a share, the largest first."""
        return tuple(share.variable for share in self.shares if share.share > 0)

    def words(self, large: bool, settings: ResidualMapSettings = ResidualMapSettings()) -> str:
        """What is said where no variable has a share; "" where one has.

        ``large``: whether more is left than noise would leave.
        """
        if self.leading:
            return ""
        if not self.shares or (large and self.seconds < settings.min_telling_duration):
            return "the logs are too short to tell on what it depends"
        if large:
            return "it depends on no single variable by a share that these logs could show"
        return "it depends on no variable more than chance would have it"

    def curve(self, variable: str) -> list[Curve]:
        """The residual over a variable, for a plot: one curve, or one for each component of twist.

        Over the twist: the residual of the refitted model. Over another variable: what remains of
        it after a function of the twist. Empty if the logs were too short for a map.

        Raises
        ------
        KeyError
            If the logs have no such variable.
        """
        share = {share.variable: share for share in self.shares}[variable]
        return [] if self._curves is None else self._curves(share)
