"""Recursive least squares with forgetting, for long runs: it detects changes and does not drift.

:class:`identification.fitting.recursive.RecursiveLeastSquares` gets four guards. Rows of an axis
that hardly moves are not used. No direction becomes less certain than at the start, so that noise
does not move parameters that the motion does not show. The size of the residuals is measured, so
that a model that lacks an effect learns slowly. If the residuals suddenly become much larger, the
parameters have changed, and the covariance is set back to that of the start.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controllers.interface import Array
from identification.fitting.recursive import RecursiveLeastSquares
from youbot_env.errors import check_settings


@dataclass(frozen=True)
class EstimatorSettings:
    """The guards around the recursion: when a row is used, and what counts as a change."""

    min_noise: float = field(
        default=0.02,
        metadata={
            "unit": "N m",
            "reason": "what a row misses by at best: the encoders' noise at 100 Hz",
        },
    )
    min_excitation: float = field(
        default=0.5,
        metadata={
            "unit": "N m",
            "reason": "rms of an axis' demanded force; below it a row shows noise alone",
        },
    )
    excitation_time: float = field(
        default=1.0,
        metadata={
            "unit": "s",
            "reason": "average of the excitation: longer than a reversal at standstill",
        },
    )
    noise_time: float = field(
        default=10.0,
        metadata={
            "unit": "s",
            "reason": "average of the noise: slow, so that a change is not taken for noise",
        },
    )
    surprise_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "average of the surprise: ten rows, so that a single outlier is none",
        },
    )
    max_surprise: float = field(
        default=6.0,
        metadata={
            "unit": "1",
            "reason": "mean square of the misses over their expected variance; beyond it "
            "something has changed",
        },
    )
    pause_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "after it the filters have forgotten the platform as it was before a change",
        },
    )
    learning_time: float = field(
        default=2.0,
        metadata={
            "unit": "s",
            "reason": "what a change gets to be learnt; what still misses then is no change of "
            "parameters",
        },
    )
    first_deviation_share: float = field(
        default=0.1,
        metadata={
            "unit": "of the prior deviation",
            "reason": "the first estimate is right until it misses",
        },
    )
    max_miss: float = field(
        default=10.0,
        metadata={
            "unit": "N m",
            "reason": "no parameter makes a row miss by more: a collision, or drives without power",
        },
    )
    outlier_deviations: float = field(
        default=3.0,
        metadata={
            "unit": "standard deviations",
            "reason": "a miss counts as so many at most: outliers hardly raise the noise",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


class OnlineEstimator:
    """Estimates scaled parameters x (F,) from rows y = H x, one for each of three axes.

    Parameters
    ----------
    start : (F,) first estimate, in units in which each column is of the size of a force [N m]
    spread : (F,) its standard deviation, then and whenever the parameters have changed
    row_time : [s] between rows
    memory : [s] after which a row counts 1/e
    settings : of the guards

    Attributes
    ----------
    noise : (3,) [N m] standard deviation of what rows miss by, as measured
    changes : times that the parameters were found to have changed
    """

    def __init__(
        self,
        start: Array,
        spread: Array,
        row_time: float,
        memory: float,
        settings: EstimatorSettings = EstimatorSettings(),
    ) -> None:
        self._settings = settings
        self._prior = np.asarray(spread, float) ** 2
        fading = float(np.exp(-row_time / memory))
        first = settings.first_deviation_share**2 * self._prior
        self._squares = RecursiveLeastSquares(len(start), start, first, fading)
        times = settings.excitation_time, settings.noise_time, settings.surprise_time
        self._shares = row_time / np.array(times)
        self._pause = -round(settings.pause_time / row_time)
        self._grace = round(settings.learning_time / row_time)
        # As if the last change were long past: the first rows may find one.
        self._since_change = self._grace + 1
        self._excitation, self._surprise = np.zeros(3), np.zeros(3)
        self.noise = np.full(3, settings.min_noise)
        self.changes = 0

    @property
    def estimate(self) -> Array:
        """(F,)"""
        return self._squares.estimate

    @estimate.setter
    def estimate(self, value: Array) -> None:
        self._squares.estimate = value

    @property
    def spread(self) -> Array:
        """(F,) standard deviations as the recursion has them."""
        return np.sqrt(np.diag(self._squares.covariance))

    def learn(self, columns: Array, measured: Array, demand: Array) -> bool:
        """Take a row of each axis; whether the estimate has moved.

        Parameters
        ----------
        columns : (3, F)
        measured : (3,) [N m]
        demand : (3,) [N m] the whole force of the row, which tells excitation
        """
        self._excitation += self._shares[0] * (demand**2 - self._excitation)
        used = self._excitation > self._settings.min_excitation**2
        missed = measured - columns @ self.estimate
        # Written so that a row with NaN is refused too.
        if not used.any() or not np.abs(missed).max() < self._settings.max_miss:
            return False
        known = np.einsum("ai,ij,aj->a", columns, self._squares.covariance, columns)
        self._since_change += 1
        if self._since_change < 0:
            return False  # the filters still hold the platform as it was before the change
        if self._since_change == 0:
            self._start_over()
            return False
        self._judge(missed, known, used)
        # Divided by their noise, because the recursion gives all rows the same weight.
        rows = columns[used] / self.noise[used, None]
        self._squares.update(rows, measured[used] / self.noise[used])
        self._bound()
        return True

    def _judge(self, missed: Array, known: Array, used: Array) -> None:
        """Update noise and surprise by the residuals ``missed``.

        ``known`` is the part of their variance that comes from uncertain parameters.
        """
        expected = self.noise**2 + known
        ratio = np.where(used, missed**2 / expected, 0.0)
        self._surprise += self._shares[2] * (ratio - self._surprise)
        # Outliers are cut, and the part that uncertain parameters explain is not noise.
        most = self._settings.outlier_deviations**2 * expected
        level = np.maximum(np.minimum(missed**2, most) - known, 0.0)
        variance = self.noise**2 + used * self._shares[1] * (level - self.noise**2)
        self.noise = np.sqrt(np.maximum(variance, self._settings.min_noise**2))
        if self._surprise.max() <= self._settings.max_surprise:
            return
        if self._since_change > self._grace:
            # A new change: wait until the filters have settled, then start over.
            self._since_change = self._pause
            self.changes += 1
        elif self._since_change == self._grace:
            # Learning has not helped, so the residuals come from an effect that the model lacks.
            # They count as noise from now on.
            self.noise = self.noise * np.sqrt(np.maximum(self._surprise, 1.0))
            self._start_over()

    def _start_over(self) -> None:
        """Set the covariance back to that of the start and keep the estimate."""
        self._squares.covariance = np.diag(self._prior)
        self._surprise[:] = 0.0

    def _bound(self) -> None:
        """Forgetting must not make a direction less certain than it was beforehand."""
        # Rows and columns alike, so that the covariance stays symmetric and positive.
        spread = np.diag(self._squares.covariance)
        shrink = np.sqrt(np.minimum(1.0, self._prior / spread))
        self._squares.covariance = self._squares.covariance * shrink * shrink[:, None]
