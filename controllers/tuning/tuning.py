"""Tuning: the gains of a control law that track best, with and without stability margins.

A law (see :mod:`controllers.tuning.tunable_laws`) has a few free numbers. They are sought on a grid
that zooms in on its best point. This needs no gradients, works for an allowed region of any shape,
is not random, and all points of a grid are simulated together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.interface import Array, Loop
from controllers.linear.linear_system import LinearSystem, closed, sampled_platform
from controllers.linear.margins import (
    Complex,
    Margins,
    MarginSettings,
    control_margins,
    frequency_grid,
    margins,
)
from controllers.tuning.trials import Law, Score, TuningTrial
from youbot_env.errors import InputError, check_settings, finite
from youbot_env.model.model import Model

Progress = Callable[[float], None]

RATE_ROUNDING = 1e-9
"""Share of a torque rate that is rounding."""


@dataclass(frozen=True)
class SearchSettings:
    """How finely gains are sought, and what a torque rate is measured against."""

    first_grid_points: int = field(
        default=9,
        metadata={"unit": "1", "reason": "points per free number in the first round"},
    )
    grid_points: tuple[int, int, int] = field(
        default=(9, 7, 5),
        metadata={
            "unit": "1",
            "reason": "points per free number in a later round, where one, two or three are free: "
            "9, 49 or 125 loops side by side",
        },
    )
    rounds: int = field(
        default=8,
        metadata={
            "unit": "1",
            "reason": "the last grid of two free numbers has steps of 0.13 % of the span's "
            "logarithm",
        },
    )
    zoom_share: float = field(
        default=0.5,
        metadata={
            "unit": "of the span",
            "reason": "what is left of it after a round: the next grid still reaches the "
            "neighbours of the best point",
        },
    )
    torque_rate_share: float = field(
        default=1.1,
        metadata={
            "unit": "of computed torque's torque rate",
            "reason": "gains may cost the drives a tenth more than the model-based controller does",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


class TunableLaw(Protocol):
    """A control law with free numbers, as the search sees it.

    Attributes
    ----------
    names : of the free numbers
    span : lowest and highest value of each, all positive; the grid is logarithmic
    """

    names: tuple[str, ...]
    span: tuple[tuple[float, float], ...]

    def controller(self, point: Array) -> LinearSystem:
        """Measured twist error (3,) to body force (3,) at one point (p,)."""
        ...

    def response(self, point: Array, frequency: Array) -> Complex:
        """Frequency response (w, 3, 3) of :meth:`controller`."""
        ...

    def rows(self, points: Array, motions: int) -> Law:
        """Rows (c * motions) of the points (c, p), each for all motions."""
        ...


@dataclass(frozen=True)
class Requirements:
    """What tuned gains must keep.

    Attributes
    ----------
    gain_margin : [dB], at each axis
    phase_margin : [degrees], at each axis
    torque_rate : rms of the commands' change [N m/s]; None for no limit

    Raises
    ------
    InputError
        If a number is negative or not finite.
    """

    gain_margin: float = MarginSettings.gain_margin
    phase_margin: float = MarginSettings.phase_margin
    torque_rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("gain_margin", "phase_margin"):
            finite(f"requirement {name}", getattr(self, name), least=0.0)
        if self.torque_rate is not None:
            finite("requirement torque_rate", self.torque_rate, positive=True)


@dataclass(frozen=True)
class TunedGains:
    """One point of a search and what it costs.

    Attributes
    ----------
    point : the free numbers by name
    error : (3,) normalised RMSE of VX, VY, W
    torque_rate : rms [N m/s]
    saturated : share of wheel commands at the limit
    margins : of the linear loop
    poles : (S,) of the closed loop, in the s plane [1/s], the slowest first
    """

    point: Mapping[str, float]
    error: Array
    torque_rate: float
    saturated: float
    margins: Margins
    poles: Complex

    @property
    def mean_error(self) -> float:
        """Mean over the axes: what the search makes small."""
        return float(self.error.mean())

    def to_dict(self) -> dict[str, object]:
        """As a result file holds it."""
        finite_poles = self.poles[np.isfinite(self.poles)]
        return {
            "gains": dict(self.point),
            "error": self.error.tolist(),
            "mean_error": self.mean_error,
            "torque_rate": self.torque_rate,
            "saturated": self.saturated,
            "margins": self.margins.to_dict(),
            "poles": [[pole.real, pole.imag] for pole in finite_poles.tolist()],
        }


class GainSearch:
    """Finds the best gains of a law in one condition.

    Parameters
    ----------
    law : whose free numbers are sought; a point (p,) holds a value for each
    trial : platform, loop and references
    settings : how finely
    """

    def __init__(
        self, law: TunableLaw, trial: TuningTrial, settings: SearchSettings = SearchSettings()
    ) -> None:
        self.law, self.trial, self.settings = law, trial, settings
        self.plant = sampled_platform(trial.model, trial.loop)
        self.frequency = frequency_grid(trial.loop.sample_time)
        self._response = self.plant.response(self.frequency)

    def linear(self, points: Array) -> tuple[Array, Margins]:
        """Which points (c, p) are stable (c,), and their margins."""
        controllers = [self.law.controller(point) for point in points]
        stable = np.array([closed(self.plant, k).is_stable for k in controllers])
        gain = np.stack([self.law.response(point, self.frequency) for point in points])
        return stable, margins(gain @ self._response)

    def python_control_margins(self, point: Array) -> Margins:
        """The margins of one point (p,) as python-control finds them (extra: control)."""
        gain = self.law.response(point, self.frequency) @ self._response
        return control_margins(gain, self.frequency)

    def score(self, points: Array) -> Score:
        """Simulated errors and torque rates of points (c, p)."""
        return self.trial.score(self.law.rows(points, len(self.trial.motions)))

    def evaluate(self, point: Array) -> TunedGains:
        """All that is known of one point (p,)."""
        one = np.asarray(point, float)[None]
        found, (_, gap) = self.score(one), self.linear(one)
        loop = closed(self.plant, self.law.controller(one[0]))
        return TunedGains(
            dict(zip(self.law.names, one[0].tolist(), strict=True)),
            found.error[0],
            float(found.torque_rate[0]),
            float(found.saturated[0]),
            Margins(gap.gain[0], gap.phase[0]),
            loop.poles,
        )

    def best(self, wanted: Requirements | None, progress: Progress | None = None) -> TunedGains:
        """The point of least mean error that is stable and keeps what is wanted.

        Raises
        ------
        InputError
            If no point of the first grid does.
        """
        # Gains matter by their ratios, so the grid is even in their logarithms.
        low, high = np.log(np.array(self.law.span)).T
        width = (high - low) / 2  # half width of the grid, in logarithms
        centre, least = (low + high) / 2, np.inf
        point = None
        later_steps = self.settings.grid_points[len(centre) - 1]
        for turn in range(self.settings.rounds):
            steps = later_steps if turn else self.settings.first_grid_points
            points, cost = self._round(centre, width, steps, wanted)
            at = int(cost.argmin())
            if cost[at] < least:
                point, least, centre = points[at], cost[at], np.log(points[at])
            # No point of the first grid is allowed, so there is none to zoom in on.
            if point is None:
                raise InputError(_nothing_keeps(self.law, wanted))
            width = width * self.settings.zoom_share
            if progress is not None:
                progress(1.0)
        assert point is not None
        return self.evaluate(point)

    def _round(
        self, centre: Array, width: Array, steps: int, wanted: Requirements | None
    ) -> tuple[Array, Array]:
        """Points (c, p) of a grid around the centre and their costs (c,), inf where refused."""
        axes = [
            # Points beyond the span fall on its edge; unique drops the repeated ones.
            np.unique(np.clip(c + w * np.linspace(-1, 1, steps), *np.log(ends)))
            for c, w, ends in zip(centre, width, self.law.span, strict=True)
        ]
        points = np.exp(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)))
        cost = np.full(len(points), np.inf)
        kept, gap = self.linear(points)
        if wanted is not None:
            kept &= gap.gain.min(axis=-1) >= wanted.gain_margin
            kept &= gap.phase.min(axis=-1) >= wanted.phase_margin
        # Margins cost far less than a simulation, so they refuse points first.
        tried = np.flatnonzero(kept)
        if len(tried):
            found = self.score(points[tried])
            cost[tried] = found.mean_error
            if wanted is not None and wanted.torque_rate is not None:
                over = found.torque_rate > wanted.torque_rate * (1 + RATE_ROUNDING)
                cost[tried[over]] = np.inf
        return points, cost


def _nothing_keeps(law: TunableLaw, wanted: Requirements | None) -> str:
    spans = ", ".join(
        f"{name} {low:g} to {high:g}" for name, (low, high) in zip(law.names, law.span, strict=True)
    )
    if wanted is None:
        return f"tuning: no gains with {spans} are stable; check model, rate and delay"
    rate = "" if wanted.torque_rate is None else f", torque rate <= {wanted.torque_rate:.3g} N m/s"
    return (
        f"tuning: no gains with {spans} keep gain margin >= {wanted.gain_margin:g} dB, phase "
        f"margin >= {wanted.phase_margin:g} degrees{rate}; ask for less"
    )


@dataclass(frozen=True)
class Tuning:
    """The result of tuning a law.

    Attributes
    ----------
    wanted : what ``best`` keeps
    best : of least error among those that keep it
    free : of least error among all that are stable
    """

    wanted: Requirements
    best: TunedGains
    free: TunedGains


def tune(
    law: TunableLaw,
    trial: TuningTrial,
    wanted: Requirements | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Best gains of a law, with and without requirements.

    ``progress`` is told 1.0 after each round of either search.

    Raises
    ------
    InputError
        If no gains keep what is wanted.
    """
    wanted = wanted or Requirements()
    search = GainSearch(law, trial)
    best = search.best(wanted, progress)
    return Tuning(wanted, best, search.best(None, progress))


def allowed_torque_rate(model: Model, loop: Loop, trial: TuningTrial) -> float:
    """Torque rate (rms) [N m/s] that tuned gains may have: computed torque's, and a tenth more."""
    score = trial.score_controller(lambda: ComputedTorque(model, loop))
    return SearchSettings.torque_rate_share * float(score.torque_rate[0])
