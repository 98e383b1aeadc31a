"""How large an effect must be to matter: the base model's force error over its noise floor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from identification.fitting.errors import (
    NoiseLevel,
    SumsOfSquares,
    add_up,
    force_traces,
    white_force_floor,
)
from identification.fitting.least_squares import fit
from identification.mechanisms.mecanum import Mecanum
from youbot_env.model.model_file import load_model
from youbot_scripts.blind_bench.cases import draw_case, logs_of
from youbot_scripts.blind_bench.effects import EVERYTHING

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Times the effect's size."""

VISIBLE, LARGE = 3.0, 20.0
"""Force error over noise floor between which an effect is of "catalogue size"."""


class Sizing(NamedTuple):
    """One case of one effect at ``factor`` times its size."""

    name: str
    factor: float
    index: int
    seed: int


def sizings(cases: int, seed: int) -> list[Sizing]:
    """``cases`` platforms for each effect and factor."""
    return [
        Sizing(name, factor, index, seed)
        for name in EVERYTHING
        for factor in FACTORS
        for index in range(cases)
    ]


def force_ratio(sizing: Sizing) -> float:
    """Force error of the refitted base model over its noise floor."""
    logs = logs_of(draw_case(sizing.name, sizing.index, sizing.seed, factor=sizing.factor))
    model = load_model("paper")
    mechanism = Mecanum(model.geometry, model.structure)
    samples = mechanism.samples_of(logs)
    theta = fit(mechanism, samples, model.theta).theta
    traces = [force_traces(mechanism, theta, item) for item in samples]
    floor = [
        white_force_floor(mechanism, theta, item, trace, NoiseLevel.of(item), sizing.seed)
        for item, trace in zip(samples, traces, strict=True)
    ]
    return add_up(map(SumsOfSquares.of, traces)).ratio / add_up(floor).ratio


def size_table(found: Iterable[tuple[Sizing, float]]) -> dict[str, dict[str, Any]]:
    """Each effect's size, unit, median ratios by factor, and the sizes of catalogue size."""
    ratios: dict[str, dict[float, list[float]]] = defaultdict(lambda: defaultdict(list))
    for sizing, ratio in found:
        ratios[sizing.name][sizing.factor].append(ratio)
    table = {}
    for name in (name for name in EVERYTHING if name in ratios):
        item = EVERYTHING[name]
        middle = {factor: median(ratios[name][factor]) for factor in sorted(ratios[name])}
        table[name] = {
            "size": item.size,
            "unit": item.unit,
            "ratio_by_factor": {f"{factor:g}": ratio for factor, ratio in middle.items()},
            "smallest": _size_at(VISIBLE, item.size, middle),
            "largest": _size_at(LARGE, item.size, middle),
        }
    return table


def _size_at(ratio: float, size: float, middle: dict[float, float]) -> float | None:
    """Size at which a ratio is reached; None if it is not at the largest one tried.

    Noise and effect add up in squares, so the excess sqrt(ratio^2 - 1) grows with the size.
    """
    # The floor keeps the logarithm below finite.
    excess = np.sqrt(np.maximum(np.array(list(middle.values())) ** 2 - 1.0, 1e-6))
    # np.interp needs increasing abscissae, and noise can make a ratio fall.
    rising = np.maximum.accumulate(excess)
    wanted = np.sqrt(ratio**2 - 1.0)
    if wanted > rising[-1]:
        return None
    factors = np.log(list(middle))
    if wanted < rising[0]:
        # Below the smallest factor tried: excess in proportion to size.
        return float(size * np.exp(factors[0]) * wanted / rising[0])
    return float(size * np.exp(np.interp(np.log(wanted), np.log(rising), factors)))
