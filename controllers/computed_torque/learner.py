"""Recursive least squares that may run for hours: it forgets, notices changes, and does not drift.

Around :class:`identification.fitting.recursive.RecursiveLeastSquares` stand four guards. Axes that
hardly move are not learnt from. No direction becomes less certain than it was beforehand, so that
noise moves nothing that the motion does not show. What rows miss by is measured, so that a model
that lacks an effect learns slowly instead of chasing it. And where rows suddenly miss by far more,
the parameters have changed, and all that was certain is given up.
"""

from __future__ import annotations

import numpy as np

from controllers.interface import Array
from identification.fitting.recursive import RecursiveLeastSquares

LEAST_NOISE = 0.02
"""[N m] that a row misses by at best: the encoders' noise at 100 Hz."""

EXCITED = 0.5
"""[N m] rms of an axis' demanded force below which it shows noise alone."""

EXCITED_TIME, NOISE_TIME, SURPRISE_TIME = 1.0, 10.0, 0.5
"""[s] over which excitation, noise and surprise are averaged."""

SURPRISING = 6.0
"""Mean square of the misses over their expected variance at which something has changed."""

PAUSE = 0.5
"""[s] after which the filters have forgotten the platform as it was before a change."""

GRACE = 2.0
"""[s] that a change gets to be learnt; what still misses then is no change of parameters."""

TRUST = 0.1
"""Share of ``spread`` by which the first estimate is uncertain: it is right until it misses."""

BELIEVABLE = 10.0
"""[N m] by which no parameter makes a row miss: a collision, or drives without power."""


class Learner:
    """Estimates scaled parameters x (F,) from rows y = H x, one for each of three axes.

    Parameters
    ----------
    start : (F,) first estimate, in units in which each column is of the size of a force [N m]
    spread : (F,) its standard deviation, then and whenever the parameters have changed
    row_time : [s] between rows
    memory : [s] after which a row counts 1/e

    Attributes
    ----------
    noise : (3,) [N m] standard deviation of what rows miss by, as measured
    changes : times that the parameters were found to have changed
    """

    def __init__(self, start: Array, spread: Array, row_time: float, memory: float) -> None:
        self._prior = np.asarray(spread, float) ** 2
        fading = float(np.exp(-row_time / memory))
        first = TRUST**2 * self._prior
        self._squares = RecursiveLeastSquares(len(start), start, first, fading)
        self._shares = row_time / np.array([EXCITED_TIME, NOISE_TIME, SURPRISE_TIME])
        self._pause, self._grace = -round(PAUSE / row_time), round(GRACE / row_time)
        self._since_change = self._grace + 1
        self._excitation, self._surprise = np.zeros(3), np.zeros(3)
        self.noise = np.full(3, LEAST_NOISE)
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
        used = self._excitation > EXCITED**2
        missed = measured - columns @ self.estimate
        if not used.any() or not np.abs(missed).max() < BELIEVABLE:
            return False
        known = np.einsum("ai,ij,aj->a", columns, self._squares.covariance, columns)
        self._since_change += 1
        if self._since_change < 0:
            return False
        if self._since_change == 0:
            self._start_over()
            return False
        self._judge(missed, known, used)
        rows = columns[used] / self.noise[used, None]
        self._squares.update(rows, measured[used] / self.noise[used])
        self._bound()
        return True

    def _judge(self, missed: Array, known: Array, used: Array) -> None:
        """Update noise and surprise by what was missed and what was ``known`` to be uncertain."""
        expected = self.noise**2 + known
        ratio = np.where(used, missed**2 / expected, 0.0)
        self._surprise += self._shares[2] * (ratio - self._surprise)
        # A miss counts as three deviations at most: outliers hardly raise the noise.
        level = np.maximum(np.minimum(missed**2, 9.0 * expected) - known, 0.0)
        variance = self.noise**2 + used * self._shares[1] * (level - self.noise**2)
        self.noise = np.sqrt(np.maximum(variance, LEAST_NOISE**2))
        if self._surprise.max() <= SURPRISING:
            return
        if self._since_change > self._grace:
            self._since_change = self._pause
            self.changes += 1
        elif self._since_change == self._grace:
            self.noise = self.noise * np.sqrt(np.maximum(self._surprise, 1.0))
            self._start_over()

    def _start_over(self) -> None:
        """Give up all that was certain, but for the estimate."""
        self._squares.covariance = np.diag(self._prior)
        self._surprise[:] = 0.0

    def _bound(self) -> None:
        """Forgetting must not make a direction less certain than it was beforehand."""
        spread = np.diag(self._squares.covariance)
        shrink = np.sqrt(np.minimum(1.0, self._prior / spread))
        self._squares.covariance = self._squares.covariance * shrink * shrink[:, None]
