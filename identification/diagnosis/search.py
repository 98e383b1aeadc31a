"""The search for missing effects: joint fits, rankings of candidates, held-out errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.candidates import (
    Fitted,
)
from identification.fitting.cross_validation import Fold
from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    Traces,
    add_up,
    force_floor,
    force_traces,
    velocity_floor,
    velocity_traces,
)
from identification.fitting.least_squares import Fit
from identification.fitting.noise_bias import final_fit, joint_fit
from identification.fitting.observability import log_observability, refuse_blind
from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import cut
from youbot_env.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """One structure on the way: the effect accepted last, and held-out errors."""

    effect: str | None
    force_error: float
    velocity_error: float
    fitted: Fitted
    fold_thetas: Array

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.effect,
            "force_error": self.force_error,
            "velocity_error": self.velocity_error,
        }


class Search:
    """The search for missing effects on one set of logs: fits, rankings, held-out errors."""

    def __init__(
        self, mechanism: Mechanism, logs: Sequence[Log], seed: int, tick: Callable[[], None]
    ) -> None:
        self.mechanism = mechanism
        self.samples = [mechanism.samples(log) for log in logs]
        self.noise = [NoiseLevel.of(samples) for samples in self.samples]
        self.seed, self.tick = seed, tick

    def fit(self, mechanism: Any, start: Array) -> Fitted:
        """Joint fit on all logs, smooth shape constants included."""
        result = joint_fit(mechanism, self.samples, start)
        return Fitted.at(mechanism, result.theta, self.samples, result.free)

    def base(self, mechanism: Any, start: Array) -> Fitted:
        """The fit of what the model holds already.

        Raises
        ------
        InputError
            If the logs cannot show its parameters: with the motion that would.
        """
        fitted = self.fit(mechanism, start)
        refuse_blind(mechanism, log_observability(mechanism, fitted.rows))
        return fitted

    def final(self, fitted: Fitted) -> Fit:
        """The last fit of a structure, with an honest covariance: see :func:`final_fit`."""
        return final_fit(fitted.mechanism, self.samples, self.noise, fitted.theta, self.seed)

    def step(self, fitted: Fitted, effect: str | None, folds: Sequence[Fold] | None = None) -> Step:
        """Held-out force and velocity error of a structure; its own folds by default."""
        judged = fitted.judged(folds) if folds else fitted.held_out
        folds = judged.folds
        thetas = np.tile(fitted.theta, (len(folds), 1))
        thetas[:, fitted.free] += judged.steps
        # What a fold cannot see well may leave its bounds, and some free runs with them.
        thetas = np.clip(thetas, *fitted.mechanism.bounds)
        force, velocity = [], []
        for fold, theta in zip(folds, thetas, strict=True):
            part = self.stretch(fold)
            force.append(SumsOfSquares.of(force_traces(fitted.mechanism, theta, part)))
            velocity.append(SumsOfSquares.of(_free_run(fitted.mechanism, theta, part)))
            self.tick()
        return Step(effect, add_up(force).ratio, add_up(velocity).ratio, fitted, thetas)

    def stretch(self, fold: Fold) -> Any:
        """The samples of a fold."""
        samples = self.samples[fold.log]
        if fold.whole:
            return samples
        first, last = np.searchsorted(samples.time, [fold.start, fold.end])
        return cut(samples, int(first), int(last) + 1)

    def floor(self, fitted: Fitted) -> dict[str, float]:
        """What measurement noise alone would leave, at the fitted structure."""
        velocity = []
        for samples, noise in zip(self.samples, self.noise, strict=True):
            args = (fitted.mechanism, fitted.theta, samples)
            run = _free_run(*args)
            if np.isfinite(run.predicted).all():
                velocity.append(velocity_floor(*args, run, noise, self.seed))
            else:
                velocity.append(SumsOfSquares.of(run))
        _, force = self._force_squares(fitted)
        return {"force_error": force.ratio, "velocity_error": add_up(velocity).ratio}

    def above_floor(self, fitted: Fitted) -> float:
        """Force error of the fit on its own logs, over what noise alone would leave."""
        left, floor = self._force_squares(fitted)
        return left.ratio / floor.ratio

    def _force_squares(self, fitted: Fitted) -> tuple[SumsOfSquares, SumsOfSquares]:
        left, floor = [], []
        for samples, noise in zip(self.samples, self.noise, strict=True):
            args = (fitted.mechanism, fitted.theta, samples)
            traces = force_traces(*args)
            left.append(SumsOfSquares.of(traces))
            floor.append(force_floor(*args, traces, noise, self.seed))
        return add_up(left), add_up(floor)


def given_errors(mechanism: Mechanism, theta: Array, samples: Sequence[Any]) -> dict[str, float]:
    """Errors of a model as it stands, nothing fitted."""
    force = [SumsOfSquares.of(force_traces(mechanism, theta, item)) for item in samples]
    velocity = [SumsOfSquares.of(velocity_traces(mechanism, theta, item)) for item in samples]
    return {"force_error": add_up(force).ratio, "velocity_error": add_up(velocity).ratio}


def _free_run(mechanism: Any, theta: Array, samples: Any) -> Traces:
    """Velocity traces, with NaN predicted where the parameters are too stiff to simulate."""
    try:
        return velocity_traces(mechanism, theta, samples)
    except InputError:
        measured = mechanism.measured_speed(samples)
        return Traces(samples.time, measured, np.full_like(measured, np.nan))
