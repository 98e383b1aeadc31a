"""Tuning: the gains of a given structure that track best, with and without what a robot demands.

A structure (see :mod:`controllers.tuning.tunable_laws`) has a few free numbers. They are sought on
a grid that zooms in on its best point: that needs no slopes, the bound of what is allowed may be
crooked, no chance plays, and all points of a grid are simulated side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from controllers.interface import Array, Loop
from controllers.kinematic import Gains
from controllers.linear.linear_system import closed, sampled_platform
from controllers.linear.margins import (
    Complex,
    Margins,
    control_margins,
    frequency_grid,
    margins,
)
from controllers.tuning.trials import Score, TuningTrial, references
from controllers.tuning.tunable_laws import TunableKinematic, TunableLaw
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model

Progress = Callable[[float], None]

FIRST_GRID, GRID = 9, {1: 9, 2: 7, 3: 5}
"""Points per free number in the first round, and in a later one by how many are free."""

ROUNDS, ZOOM = 8, 0.5
"""Rounds of a search, and what is left of the span after each: the last grid of two free numbers
has steps of 0.13 % of the span's logarithm."""

TORQUE_RATE_SHARE = 1.1
"""Torque rate that a tuned law may have, over computed torque's in the same loop."""

RATE_MARGIN = 1e-9
"""Rounding that a constraint allows, relative."""


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

    gain_margin: float = 6.0
    phase_margin: float = 45.0
    torque_rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("gain_margin", "phase_margin"):
            finite(f"requirement {name}", getattr(self, name), least=0.0)
        if self.torque_rate is not None:
            finite("requirement torque_rate", self.torque_rate, positive=True)


@dataclass(frozen=True)
class Tuned:
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


class Bench:
    """Judges points of a structure in one condition."""

    def __init__(self, structure: TunableLaw, trial: TuningTrial) -> None:
        self.structure, self.trial = structure, trial
        self.plant = sampled_platform(trial.model, trial.loop)
        self.frequency = frequency_grid(trial.loop.sample_time)
        self._response = self.plant.response(self.frequency)

    def linear(self, points: Array) -> tuple[Array, Margins]:
        """Which points (c, p) are stable (c,), and their margins."""
        controllers = [self.structure.controller(point) for point in points]
        stable = np.array([closed(self.plant, k).is_stable for k in controllers])
        gain = np.stack([self.structure.response(point, self.frequency) for point in points])
        return stable, margins(gain @ self._response)

    def python_controls(self, point: Array) -> Margins:
        """The margins of one point (p,) as python-control finds them (extra: control)."""
        gain = self.structure.response(point, self.frequency) @ self._response
        return control_margins(gain, self.frequency)

    def score(self, points: Array) -> Score:
        """Simulated errors and torque rates of points (c, p)."""
        return self.trial.score(self.structure.law(points, len(self.trial.motions)))

    def tuned(self, point: Array) -> Tuned:
        """All that is known of one point (p,)."""
        one = np.asarray(point, float)[None]
        found, (_, gap) = self.score(one), self.linear(one)
        loop = closed(self.plant, self.structure.controller(one[0]))
        return Tuned(
            dict(zip(self.structure.names, one[0].tolist(), strict=True)),
            found.error[0],
            float(found.torque_rate[0]),
            float(found.saturated[0]),
            Margins(gap.gain[0], gap.phase[0]),
            loop.poles,
        )

    def best(self, wanted: Requirements | None, progress: Progress | None = None) -> Tuned:
        """The point of least mean error that is stable and keeps what is wanted.

        Raises
        ------
        InputError
            If no point of the first grid does.
        """
        low, high = np.log(np.array(self.structure.span)).T
        width = (high - low) / 2
        centre, least = (low + high) / 2, np.inf
        point = None
        for turn in range(ROUNDS):
            steps = GRID[len(centre)] if turn else FIRST_GRID
            points, cost = self._round(centre, width, steps, wanted)
            at = int(cost.argmin())
            if cost[at] < least:
                point, least, centre = points[at], cost[at], np.log(points[at])
            if point is None:
                raise InputError(_nothing_keeps(self.structure, wanted))
            width = width * ZOOM
            if progress is not None:
                progress(1.0)
        assert point is not None
        return self.tuned(point)

    def _round(
        self, centre: Array, width: Array, steps: int, wanted: Requirements | None
    ) -> tuple[Array, Array]:
        """Points (c, p) of a grid around the centre and their costs (c,), inf where refused."""
        axes = [
            np.unique(np.clip(c + w * np.linspace(-1, 1, steps), *np.log(ends)))
            for c, w, ends in zip(centre, width, self.structure.span, strict=True)
        ]
        points = np.exp(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)))
        cost = np.full(len(points), np.inf)
        kept, gap = self.linear(points)
        if wanted is not None:
            kept &= gap.gain.min(axis=-1) >= wanted.gain_margin
            kept &= gap.phase.min(axis=-1) >= wanted.phase_margin
        tried = np.flatnonzero(kept)
        if len(tried):
            found = self.score(points[tried])
            cost[tried] = found.mean_error
            if wanted is not None and wanted.torque_rate is not None:
                over = found.torque_rate > wanted.torque_rate * (1 + RATE_MARGIN)
                cost[tried[over]] = np.inf
        return points, cost


def _nothing_keeps(structure: TunableLaw, wanted: Requirements | None) -> str:
    spans = ", ".join(
        f"{name} {low:g} to {high:g}"
        for name, (low, high) in zip(structure.names, structure.span, strict=True)
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
    """The result of tuning a structure.

    Attributes
    ----------
    wanted : what ``best`` keeps
    best : of least error among those that keep it
    free : of least error among all that are stable
    """

    wanted: Requirements
    best: Tuned
    free: Tuned


def tune(
    structure: TunableLaw,
    trial: TuningTrial,
    wanted: Requirements | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Best gains of a structure, with and without requirements.

    ``progress`` is told 1.0 after each of 2 ``ROUNDS`` rounds.

    Raises
    ------
    InputError
        If no gains keep what is wanted.
    """
    wanted = wanted or Requirements()
    bench = Bench(structure, trial)
    best = bench.best(wanted, progress)
    return Tuning(wanted, best, bench.best(None, progress))


def tuned_kinematic(
    model: Model,
    loop: Loop,
    wanted: Requirements | None = None,
    *,
    lead: bool = False,
    seed: int = 0,
    runs: int = 4,
) -> Gains:
    """Gains of ``KinematicControl`` for a model and a loop, on multisines of 0.5 to 3 rad/s.

    Parameters
    ----------
    wanted : margins and torque rate; None is 6 dB, 45 degrees, and 1.1 times the torque rate of
        computed torque on the same model in the same loop
    lead : whether the reference may be read ahead too, as no stock control does
    seed : of references and noise
    runs : references

    Raises
    ------
    InputError
        If no gains keep what is wanted.
    """
    trial = TuningTrial(model, loop, references(model, count=runs, seed=seed), seed=seed)
    wanted = wanted or Requirements(torque_rate=allowed_torque_rate(model, loop, trial))
    bench = Bench(TunableKinematic(model, loop, lead=lead), trial)
    return Gains(**bench.best(wanted).point)


def allowed_torque_rate(model: Model, loop: Loop, trial: TuningTrial) -> float:
    """1.1 times the torque rate (rms) [N m/s] of computed torque in the trial."""
    from controllers.computed_torque.computed_torque import ComputedTorque

    score = trial.score_controller(lambda: ComputedTorque(model, loop))
    return TORQUE_RATE_SHARE * float(score.torque_rate[0])
