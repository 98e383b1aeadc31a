"""When a log began on the clock of an effect that no log shows: of a deck that swings, its phase.

What repeats itself in time goes on while nobody records. Its period and its size are the same in
all logs; where in its period a log began is a number of each log, like the place and the speed that
a run starts from. It is read from the log: of all starts within a period the one at which the model
leaves the least force. So it is known of a log with torques, also of one that no fit has seen, and
of no run that is still to come: there the effect begins at the start of its period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from identification.fitting.regression import regression
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from youbot_env.physics.effect import Effect

Array = NDArray[np.float64]


def has_own_clock(mechanism: Mechanism) -> bool:
    """Whether a mechanism has an effect on a clock of its own, and no other reads a clock.

    The logs' common clock, where another effect reads it, is left as it is.
    """
    return _swinging(mechanism) is not None


def words_of_clock(
    mechanism: Mechanism, samples: Sequence[Samples], settings: FitSettings = FitSettings()
) -> list[str]:
    """What was read from logs that are placed on a clock, in a sentence; [] where there is none."""
    swinging = _swinging(mechanism)
    if swinging is None:
        return []
    shown = samples[: settings.shown_starts]
    starts = [f"{item.name} at {item.start:.3g} s" for item in shown]
    more = ", ..." if len(samples) > len(shown) else ""
    return [
        f"where in its period {swinging.effect.name} is when a log begins is a number of that log, "
        f"read from its torques: {', '.join(starts)}{more}. Of a run that has no log yet it is not "
        "known"
    ]


def placed_on_clock(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    settings: FitSettings = FitSettings(),
) -> list[Samples]:
    """The same samples, each with its start within a period of the mechanism's own clock.

    They are returned as they are where the mechanism has no such effect, or it has no strength.

    Parameters
    ----------
    theta : (P,) of the model, which knows the period and the size
    """
    swinging = _swinging(mechanism)
    if swinging is None:
        return list(samples)
    period = float(theta[swinging.period])
    return [_placed(mechanism, theta, item, period, settings) for item in samples]


def first_placed_on_clock(
    mechanism: Mechanism,
    theta: Array,
    samples: Sequence[Samples],
    settings: FitSettings = FitSettings(),
) -> list[Samples]:
    """The same where the size of what swings is not known yet: that of the longest log is taken.

    Parameters
    ----------
    theta : (P,) of the model without it, and with its period
    """
    swinging = _swinging(mechanism)
    if swinging is None:
        return list(samples)
    strengths = swinging.strengths
    longest = max(samples, key=lambda item: len(item) * item.dt)
    rows = regression(mechanism, theta, longest, strengths, settings)
    columns = rows.columns.reshape(-1, len(strengths))
    theta = theta.copy()
    theta[strengths] += np.linalg.lstsq(columns, rows.residual.ravel(), rcond=None)[0]
    return placed_on_clock(mechanism, theta, samples, settings)


class _Swinging(NamedTuple):
    """The effect on a clock of its own, and where its parameters stand in theta."""

    effect: Effect
    where: slice

    @property
    def period(self) -> int:
        """Where its period stands."""
        return self.where.start + self.effect.parameter_names.index(self.effect.own_clock)

    @property
    def strengths(self) -> NDArray[np.intp]:
        """Where the parameters stand in which it is linear."""
        declared = [self.effect.parameter(name) for name in self.effect.parameter_names]
        linear = [k for k, parameter in enumerate(declared) if not parameter.is_shape]
        return self.where.start + np.array(linear, np.intp)


def _swinging(mechanism: Mechanism) -> _Swinging | None:
    """The only effect that reads a clock, if that is its own."""
    structure = mechanism.structure
    found = [_Swinging(*row) for row in structure.slices if row[0].own_clock]
    if len(found) != 1:
        return None
    others = [name for name in structure.effects if name != found[0].effect.name]
    return None if structure.with_effects(others).reads_start else found[0]


def _placed(
    mechanism: Mechanism, theta: Array, samples: Samples, period: float, settings: FitSettings
) -> Samples:
    count = 2 * settings.clock_harmonics + 1
    nothing = np.zeros(0, np.intp)
    rows = [
        regression(mechanism, theta, replace(samples, start=start), nothing, settings).residual
        for start in period * np.arange(count) / count
    ]
    left = np.stack([row.ravel() for row in rows])
    gram = left @ left.T
    turn = np.linspace(0.0, 1.0, settings.clock_steps, endpoint=False)
    weights = _between(turn, count)
    squares = np.einsum("sk,kl,sl->s", weights, gram, weights)
    best, size = int(np.argmin(squares)), float(squares.mean())
    if squares.max() - squares.min() <= settings.min_clock_share * size:
        return samples  # it does not act in this log
    return replace(samples, start=float(turn[best] * period))


def _between(turn: Array, count: int) -> Array:
    """(s, count) weights that give a periodic curve at parts of its period from ``count`` values.

    Exact of a curve with (count - 1)/2 harmonics: trigonometric interpolation.
    """
    order = np.arange(1, (count - 1) // 2 + 1)
    way = turn[:, None] - np.arange(count) / count
    return (1.0 + 2.0 * np.cos(2 * np.pi * way[..., None] * order).sum(axis=-1)) / count
