"""Trials gathered: one result for each controller, condition and band, over its seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from controllers.loop import Trace
from youbot_scripts.evaluation.metrics import AXES, interval, mean_nrmse
from youbot_scripts.shared.results_folder import Record

BY_AXIS = ("nrmse", "rmse", "worst")
"""Metrics with a number for each axis."""

OVERALL = (
    "position_drift",
    "heading_drift",
    "effort",
    "torque_rate",
    "saturation",
)
"""Metrics with one number for a run."""

STRETCHES = "course"
"""Metrics with one number for each stretch of a run: "course 1", "course 2" ..."""

SATURATED = 0.001
"""Share of samples at a torque limit above which a comparison is shown but not scored, because the
limit then determines the error, not the controller."""

RUNS_ALSO = ", in the runs also "
"""In a plant's name, separates effects in logs and runs from those in the runs only."""

Interval = dict[str, Any]


@dataclass(frozen=True)
class Result:
    """One controller in one condition and band.

    Attributes
    ----------
    place : plant, model and loop, as ``Condition.to_dict`` gives them
    band : [rad/s]
    runs, diverged : how many there were, and how many of them diverged
    metrics : mean and interval over the runs that did not diverge, by name; those by axis are
        named ``nrmse VX`` and so on; ``nrmse`` alone is the mean over the axes
    """

    place: dict[str, Any]
    band: tuple[float, float]
    controller: str
    runs: int
    diverged: int
    metrics: dict[str, Interval]

    def mean(self, name: str) -> float:
        """A metric's mean over the runs; NaN if one diverged, since the rest would be biased."""
        value = self.metrics[name]["mean"]
        return math.nan if self.diverged or value is None else value

    def half(self, name: str) -> float:
        """Half width of its interval; 0 if there is none."""
        return 0.0 if self.diverged else self.metrics[name]["half"] or 0.0

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            **self.place,
            "band": list(self.band),
            "controller": self.controller,
            "runs": self.runs,
            "diverged": self.diverged,
            "metrics": self.metrics,
        }


@dataclass(frozen=True)
class TimeCourse:
    """Closed loops of one condition over time, by controller; condition and reference in words."""

    condition: str
    reference: str
    traces: dict[str, Trace]


def gather(trials: Sequence[Record]) -> list[Result]:
    """The results of trials, in the order in which their groups begin."""
    groups: dict[str, list[Record]] = {}
    for trial in trials:
        groups.setdefault(json.dumps([_place(trial), trial["band"], trial["controller"]]), [])
        groups[json.dumps([_place(trial), trial["band"], trial["controller"]])].append(trial)
    return [_result(group) for group in groups.values()]


def _place(trial: Record) -> dict[str, Any]:
    return {name: trial[name] for name in ("plant", "model", "loop")}


def _result(group: Sequence[Record]) -> Result:
    sound = [trial for trial in group if trial["diverged"] is None]
    metrics = {name: interval([trial[name] for trial in sound]) for name in OVERALL}
    for name in BY_AXIS:
        for axis, label in enumerate(AXES):
            moving = [t[name][axis] for t in sound if t[name][axis] is not None]
            metrics[f"{name} {label}"] = interval(moving)
    stretches = min((len(trial["course"]) for trial in sound), default=0)
    for k in range(stretches):
        metrics[f"{STRETCHES} {k + 1}"] = interval([trial["course"][k] for trial in sound])
    metrics["nrmse"] = interval([mean_nrmse(trial) for trial in sound])
    first = group[0]
    low, high = first["band"]
    return Result(
        _place(first),
        (low, high),
        first["controller"],
        len(group),
        len(group) - len(sound),
        metrics,
    )


def unscored(results: Sequence[Result]) -> dict[tuple[float, float], str]:
    """Bands of one condition that are not scored because of a torque limit, and why, in words."""
    found = {}
    for result in results:
        share = result.metrics["saturation"]["mean"]
        if share is not None and share > SATURATED:
            reason = f"{result.controller} saturates {100 * share:.1f} % of the time"
            # One reason for a band is enough: that of the first controller.
            found.setdefault(result.band, reason)
    return found


def ratios(results: Sequence[Result], against: str) -> dict[tuple[float, float], dict[str, float]]:
    """By band and controller: error over that of another controller, on the worst of the axes."""
    found: dict[tuple[float, float], dict[str, float]] = {}
    for other in (r for r in results if r.controller == against):
        row = found.setdefault(other.band, {})
        for result in (r for r in results if r.band == other.band):
            values = [
                result.mean(f"nrmse {axis}") / other.mean(f"nrmse {axis}")
                for axis in AXES
                if other.metrics[f"nrmse {axis}"]["mean"] != 0
            ]
            row[result.controller] = max(values) if all(map(math.isfinite, values)) else math.nan
    return found


def by_condition(results: Sequence[Result]) -> list[list[Result]]:
    """The results of each condition."""
    return _alike(results, lambda result: json.dumps(result.place))


def by_plant(results: Sequence[Result]) -> list[list[Result]]:
    """The results of each plant, whatever model of it the controllers had."""
    return _alike(results, lambda result: result.place["plant"])


def models_of(results: Sequence[Result]) -> list[str]:
    """The models that results were found with, in their order."""
    return list(dict.fromkeys(result.place["model"] for result in results))


def controllers_of(results: Sequence[Result]) -> list[str]:
    """The controllers that results are of, in their order."""
    return list(dict.fromkeys(result.controller for result in results))


def bands_of(results: Sequence[Result]) -> list[tuple[float, float]]:
    """The bands [rad/s] of results, from low to high."""
    return sorted({result.band for result in results})


def headline(group: Sequence[Result], against: str) -> str:
    """One condition in a sentence: who tracks best, how well, and how far below another one."""
    means = {
        name: math.fsum(found) / len(found)
        for name in controllers_of(group)
        if (found := [r.mean("nrmse") for r in group if r.controller == name])
        and all(map(math.isfinite, found))
    }
    lost = ", ".join(dict.fromkeys(result.controller for result in group if result.diverged))
    tail = f"; {lost} diverges" if lost else ""
    if not means:
        return f"On the model {group[0].place['model']!r} no controller follows every band{tail}"
    best = min(means, key=means.__getitem__)
    other = means.get(against)
    apart = f" against {100 * other:.3g} % of {against}" if other and best != against else ""
    model = group[0].place["model"]
    return (
        f"Built on the model {model!r}, {best} tracks best: it misses the reference by "
        f"{100 * means[best]:.3g} % on average{apart}{tail}"
    )


def _alike(results: Sequence[Result], key: Callable[[Result], str]) -> list[list[Result]]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return list(groups.values())


def in_words(place: dict[str, Any]) -> str:
    """Plant, model and loop in one line."""
    loop = place["loop"]
    samples = f"{loop['delay']} sample" + ("" if loop["delay"] == 1 else "s")
    lag = f", lag {1000 * loop['lag']:g} ms" if loop["lag"] else ""
    pose = ", pose measured" if loop["pose"] else ""
    return (
        f"plant {place['plant']}, model {place['model']}; {loop['rate']:g} Hz, delay {samples}"
        f"{lag}, noise {loop['noise']:g} rad/s{pose}"
    )
