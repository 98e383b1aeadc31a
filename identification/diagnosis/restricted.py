"""Effects in some logs only: which logs an effect acts in, from sums over each log.

A floor may slope in one log of three, a load may be on since Tuesday. The columns of an effect that
acts in some logs only are those of the effect, and zero elsewhere. So all choices of logs follow
from the same sums over each log, which cost no more than one candidate's.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.cross_validation import block_sums
from youbot_env.physics.effect import INSTANCE, effect_of

Array = NDArray[np.float64]
Logs = tuple[int, ...]
"""Numbers of logs, from 0."""


def instance_name(effect: str, logs: Logs) -> str:
    """Of an effect that acts in some logs only: floor_tilt@2,3."""
    return f"{effect_of(effect)}{INSTANCE}{','.join(str(k + 1) for k in logs)}"


def can_differ(names: Sequence[str]) -> bool:
    """Whether there are several logs, which their names tell apart."""
    return len(names) > 1 and len(set(names)) == len(names)


def choices(count: int, settings: DiagnosisSettings) -> list[Logs]:
    """Sets of logs, of ``count``, in which an effect may act, fewest logs first.

    All sets where there are few logs; else single ones, those since one, and those before one.
    """
    if count <= settings.max_logs_for_any_choice:
        every = range(1, count)
        return [chosen for size in every for chosen in combinations(range(count), size)]
    singles = [(k,) for k in range(count)]
    since = [tuple(range(k, count)) for k in range(1, count)]
    until = [tuple(range(k)) for k in range(1, count)]
    return sorted({*singles, *since, *until}, key=lambda logs: (len(logs), logs))


class BaseSums:
    """Sums over each log of a structure's columns and its residual: the same for all candidates.

    Parameters
    ----------
    residual : per log (n, A), at the structure's least squares or near it
    columns : per log (n, A, q) of the structure, in directions that data can see
    step : from one row to the next [s]
    """

    def __init__(
        self,
        residual: Sequence[Array],
        columns: Sequence[Array],
        step: float,
        settings: DiagnosisSettings,
    ) -> None:
        self.residual, self.columns, self.step = residual, columns, step
        self.settings = settings
        self.scores = self.scores_of(columns)
        gram = np.sum([_product(c, c) for c in columns], axis=0)
        self.inverse = _pinv(gram, settings.min_seen_share)
        self.side = np.sum([part.sum(axis=0) for part in self.scores], axis=0)

    def scores_of(self, columns: Sequence[Array]) -> list[Array]:
        """Per log (blocks, f): columns (n, A, f) times the residual, by block of time."""
        length = self.settings.residual_map.bootstrap_block_time
        return [
            block_sums(np.einsum("na,naf->nf", r, c), self.step, length)
            for c, r in zip(columns, self.residual, strict=True)
        ]


class LogSums:
    """The same of a candidate: its columns, per log (n, A, f), beside the structure's."""

    def __init__(self, base: BaseSums, columns: Sequence[Array]) -> None:
        self.settings, self.least = base.settings, base.settings.min_seen_share
        self.inverse, self.side, self.base_scores = base.inverse, base.side, base.scores
        self.scores = base.scores_of(columns)
        self.cross = np.stack([_product(b, c) for b, c in zip(base.columns, columns, strict=True)])
        self.own = np.stack([_product(c, c) for c in columns])

    def __len__(self) -> int:
        return len(self.own)

    def step(self, logs: Sequence[int]) -> tuple[float, Array]:
        """Fall of the fitted squares, and the strengths (f,), if the effect acts in these logs."""
        chosen = list(logs)
        cross, own = self.cross[chosen].sum(axis=0), self.own[chosen].sum(axis=0)
        side = np.sum([self.scores[k].sum(axis=0) for k in chosen], axis=0)
        # Frisch, Waugh and Lovell: what the structure's own parameters absorb is no merit.
        side = side - cross.T @ self.inverse @ self.side
        left = own - cross.T @ self.inverse @ cross
        # Where the structure absorbs all of a column, rounding is what is left of it.
        gone = np.diag(left) <= self.least * np.diag(own)
        left[gone], left[:, gone], side[gone] = 0.0, 0.0, 0.0
        strength = _pinv(left, self.least) @ side
        return float(side @ strength), strength

    def score_blocks(self, logs: Sequence[int]) -> Array:
        """Block sums (blocks of all logs, f) of the effect's score, the structure's taken out."""
        absorbed = self.inverse @ self.cross[list(logs)].sum(axis=0)
        pairs = zip(self.scores, self.base_scores, strict=True)
        found = [
            (mine if k in logs else np.zeros_like(mine)) - theirs @ absorbed
            for k, (mine, theirs) in enumerate(pairs)
        ]
        return np.concatenate(found)

    def best_choice(
        self,
        square: float,
        gain_everywhere: float,
        can_be: Callable[[Logs, Array], bool],
    ) -> tuple[Logs, float] | None:
        """The logs in which the effect acts, and its fall; None if it is no better than in all.

        Parameters
        ----------
        square : fitted squares of the structure
        gain_everywhere : fall of the effect in all logs
        can_be : whether these logs, with these strengths (f,), can be
        """
        settings, found = self.settings, []
        least = gain_everywhere + settings.min_extension_gain * square
        for logs in choices(len(self), settings):
            fall, strength = self.step(logs)
            if fall >= least and can_be(logs, strength):
                found.append((logs, fall))
        if not found:
            return None
        # Logs that hardly show the effect make no difference: the fewest logs are named.
        enough = max(fall for _, fall in found) - settings.min_choice_gain * square
        return next((logs, fall) for logs, fall in found if fall >= enough)

    def all_scores(self, effect: str, but: Collection[str] = ()) -> dict[str, Array]:
        """Score blocks of the effect in each choice of logs, by the names of instances."""
        named = {instance_name(effect, logs): logs for logs in choices(len(self), self.settings)}
        return {name: self.score_blocks(logs) for name, logs in named.items() if name not in but}


def _product(left: Array, right: Array) -> Array:
    """(p, q) sums over rows and axes of columns (n, A, p) times columns (n, A, q)."""
    return left.reshape(-1, left.shape[-1]).T @ right.reshape(-1, right.shape[-1])


def _pinv(gram: Array, least: float) -> Array:
    """Inverse of normal equations; directions that are not seen are left out."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scale = np.outer(size, size)
    return np.linalg.pinv(gram / scale, rcond=least, hermitian=True) / scale
