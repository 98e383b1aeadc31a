"""Bias of a force fit by noise on the speeds, measured by adding more, and taken away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identification.fitting.errors import NoiseLevel
from identification.fitting.gauge import gauge_basis
from identification.fitting.least_squares import Fit, fit, solve_step
from identification.fitting.regression import acting_slope, by_share, regression
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism, pass_over
from identification.mechanisms.samples import Samples

Array = NDArray[np.float64]


def joint_fit(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    start: Array,
    settings: FitSettings = FitSettings(),
) -> Fit:
    """Fit of the free parameters, then of those and the smooth shape constants together."""
    found = fit(mechanism, samples, start, settings=settings)
    smooth = np.array(
        [bool(label.parameter.grid) and not label.parameter.whole for label in mechanism.labels]
    )
    if not smooth.any():
        return found
    free = mechanism.free | smooth
    more = fit(mechanism, samples, found.theta, free=free, settings=settings)
    # Where a shape and a strength can replace each other, the joint fit may diverge. Then the
    # result of the search is kept.
    most = settings.max_shape_square_ratio * found.square
    astray = more.square > most or not np.isfinite(more.theta).all()
    return found if astray else more


def extrapolated_fit(
    mechanism: Mechanism,
    samples: Sequence[Samples],
    noise: Sequence[NoiseLevel],
    found: Fit,
    seed: int,
    settings: FitSettings = FitSettings(),
) -> Fit:
    """Simulation and extrapolation (Cook and Stefanski, JASA 89, 1994) in the speeds' noise.

    Noise on the speeds is noise on the columns. It smooths the step of a dry friction and, in long
    logs, biases the estimates by several standard deviations. The bias is measured with one and
    two times more noise variance; a parabola through these points is extrapolated to no noise.

    Parameters
    ----------
    noise : of each log
    found : the fit to correct
    seed : of the noise that is added
    """
    more = _Noise(mechanism, samples, noise, found, seed, settings)
    (once, first), (twice, second) = more.shift(1.0), more.shift(2.0)
    lower, upper = (bound[found.free] for bound in mechanism.bounds)
    theta = found.theta.copy()
    # The parabola through 0, `once` and `twice` at 0, 1 and 2 times more variance has the value
    # twice - 3 once at -1, where the measured noise itself is taken away.
    inside = np.clip(theta[found.free] - 3.0 * once + twice, lower, upper)
    # If the fit with more noise fails, the estimate stays as it was.
    theta[found.free] = np.where(np.isfinite(inside), inside, theta[found.free])
    covariance = found.covariance
    std = np.maximum(found.std, 1e-300)
    if (np.abs([first, second]) > settings.min_noise_scatter * std).any():
        # Two draws exist already: `first` and `second`.
        draws_left = settings.noise_scatter_draws - 2
        draws = [first, second, *(more.shift(1.0)[1] for _ in range(draws_left))]
        covariance = covariance + np.mean([np.outer(d, d) for d in draws], axis=0)
    return replace(found, theta=theta, covariance=covariance)


class _Noise:
    """Effect of speed noise on a fit, measured by adding such noise to the logs."""

    def __init__(
        self,
        mechanism: Mechanism,
        samples: Sequence[Samples],
        noise: Sequence[NoiseLevel],
        found: Fit,
        seed: int,
        settings: FitSettings,
    ) -> None:
        self.mechanism, self.samples, self.noise = mechanism, samples, noise
        self.settings = settings
        self.found, self.rng = found, np.random.default_rng(seed)
        self.basis = gauge_basis(mechanism, found.free)

    def shift(self, level: float) -> tuple[Array, Array]:
        """How added noise of ``level`` times the logs' variance shifts the free parameters.

        Returns two (F,), from one draw of noise and its negative: the even part, which is a bias,
        and the odd part, which is a draw of the scatter, scaled to ``level`` 1.
        """
        seed = int(self.rng.integers(2**32))
        # The same seed twice: minus is exactly the negative of the noise in plus.
        plus, minus = (self._step(sign * np.sqrt(level), seed) for sign in (1.0, -1.0))
        return 0.5 * (plus + minus) - self._still, 0.5 * (plus - minus) / np.sqrt(level)

    @cached_property
    def _still(self) -> Array:
        """(F,) step without added noise: what a search that ended early still lacks is no bias."""
        return self._step(0.0, 0)

    @cached_property
    def _slope(self) -> Array:
        """(F,) see `acting_slope`; noise on the speeds does not change the torque."""
        return acting_slope(self.mechanism, self.found.theta, self.samples, self.found.free)

    def _step(self, size: float, seed: int) -> Array:
        rng, found = np.random.default_rng(seed), self.found
        rows = []
        for item, of in zip(self.samples, self.noise, strict=True):
            # Speeds only: they enter the columns, and noise in columns biases least squares. Noise
            # on the torques enters the residual alone.
            added = self.mechanism.speed_noise(item, size * of.speed, rng)
            pass_over(rng, item.torque.size)
            args = (self.mechanism, found.theta, item, found.free, self.settings, added)
            rows.append(regression(*args))
        rows = by_share(rows, self._slope)
        even = [np.ones(len(row.residual)) for row in rows]
        step, _ = solve_step(
            self.mechanism, rows, even, found.theta, found.free, self.basis, self.settings
        )
        return step
