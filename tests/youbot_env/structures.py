"""Every physical model that a law is tested on: the base, each effect of the catalogue, and all.

Nothing here names an effect, so that one added to the catalogue is tested unasked.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mechanism import Instant, ModelStructure

BASE_ONLY, EVERYTHING = "base", "everything"

EFFECTS = CATALOGUE.names()
CASES = (BASE_ONLY, *EFFECTS, EVERYTHING)
"""Names of the models to test; parametrise over these."""

SLOT_PATTERN = np.array([1.0, 0.0, 0.3, 0.6])
"""Sizes of per-wheel parameters in units of the catalogue size: uneven, none below zero."""


def catalogue_values(name: str, share: float = 1.0) -> dict[str, float]:
    """An effect's parameters, as people state them, at a share of the catalogue size; shapes at
    their defaults."""
    values: dict[str, float] = {}
    for parameter in CATALOGUE[name].public_parameters:
        for i, key in enumerate(parameter.names):
            part = share * (SLOT_PATTERN[i] if parameter.each_wheel else 1.0)
            if parameter.without > parameter.size:
                part = 1 / share  # the larger, the weaker
            values[key] = part * parameter.size if parameter.default is None else parameter.default
    return values


@cache
def model(case: str) -> Model:
    """The paper's model with the effects of a case at catalogue size."""
    effects = {BASE_ONLY: (), EVERYTHING: together()}.get(case, (case,))
    made = load_model("paper")
    # All at once at full size would leave too little motion to test anything on.
    share = 0.5 if case == EVERYTHING else 1.0
    for name in effects:
        made = made.with_effect(name, **catalogue_values(name, share))
    return made


def internal_values(name: str) -> np.ndarray:
    """The same in the form that the effect's function takes."""
    stated = catalogue_values(name).values()
    return np.array(CATALOGUE[name].to_internal(np, Geometry(), stated), float)


def together() -> tuple[str, ...]:
    """All effects, but of those that exclude each other (two drives) the first."""
    kinds, chosen = set(), []
    for effect in CATALOGUE:
        if effect.acts_at.kind == "actuator" and "actuator" in kinds:
            continue
        kinds.add(effect.acts_at.kind)
        chosen.append(effect.name)
    return tuple(chosen)


def random_instant(rng: np.random.Generator, count: int | None = None) -> Instant:
    """Motions within the platform's range; ``count`` of them as arrays, or one of floats."""

    def draw(*scale: float) -> tuple:
        values = rng.uniform(-1, 1, (len(scale), count or 1)) * np.array(scale)[:, None]
        return tuple(values) if count else tuple(float(v[0]) for v in values)

    return Instant(
        twist=draw(0.8, 0.8, 1.5),
        acceleration=draw(2.0, 2.0, 4.0),
        pose=draw(3.0, 3.0, 6.0),
        wheel_angle=draw(50.0, 50.0, 50.0, 50.0),
        torque=draw(2.0, 2.0, 2.0, 2.0),
        torque_rate=draw(20.0, 20.0, 20.0, 20.0),
        # As often before as after the moment at which an effect begins.
        time=draw(30.0)[0] + 30.0,
        start=draw(30.0)[0] + 30.0,
        torque_second_rate=draw(2e2, 2e2, 2e2, 2e2),
    )


def state_of(structure: ModelStructure, at: Instant) -> list[float]:
    """The state of a platform in a motion."""
    state = [*at.twist, *at.pose, *at.wheel_angle, at.time]
    drives = [*at.torque, *at.torque_rate]
    state += drives[: 4 * structure.drive_order]
    return state + ([at.start] if structure.reads_start else [])


def drive(time: np.ndarray, size: float = 1.0) -> np.ndarray:
    """(N, 4) smooth torques [N m] that move the platform every way and reverse its wheels."""
    tones = np.array([[2.1, 0.3], [2.9, 1.7], [3.7, 0.9]])
    x, y, w = np.sin(time[:, None] * tones[:, 0] + tones[:, 1]).T
    return size * np.stack([x - 0.7 * y - 0.5 * w, x + 0.7 * y + 0.5 * w] * 2, axis=1) * np.array(
        [1.0, 1.0, 0.7, 0.7]
    ) + size * 0.4 * np.stack([-y, y, y, -y], axis=1)


def exact_step(model: Model, state: np.ndarray, torque: np.ndarray, duration: float) -> np.ndarray:
    """State (S,) after a torque was held for a time [s], by scipy's eighth-order method."""
    solved = solve_ivp(
        lambda _, x: model.state_derivative(x, torque),
        (0.0, duration),
        state,
        method="DOP853",
        rtol=1e-11,
        atol=1e-13,
    )
    return solved.y[:, -1]
