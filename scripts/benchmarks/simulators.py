"""Simulated seconds a second on one thread: this package, MuJoCo's rollers, scipy's solver.

Bare dynamics take wheel torques and give states; a full environment adds sensors with noise,
references, observations, rewards and new episodes. Rows say which they are.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from scipy.integrate import solve_ivp

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.simulation.compiled import derivative
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.plant import Plant
from youbot_scripts.benchmarks.speed import FULL

PERIOD = 0.01
"""Time for which a torque is held [s]."""

CONTACT = "MuJoCo, rollers in contact: bare"


@dataclass(frozen=True)
class SimulatorSettings:
    """How bare dynamics are measured."""

    rounds: int = field(
        default=9, metadata={"unit": "1", "reason": "a median of few: MuJoCo's turn takes 0.1 s"}
    )
    steps: int = field(
        default=50, metadata={"unit": "periods a turn", "reason": "half a second of simulated time"}
    )
    tolerance: float = field(
        default=1e-8,
        metadata={"unit": "1", "reason": "solve_ivp's rtol and atol: what `Plant` keeps"},
    )


@dataclass(frozen=True)
class Simulator:
    """A row: ``rate`` simulated seconds a second of one core, over ``platforms`` side by side.

    ratio : median over turns of the full environment's rate, in a batch, by this one's
    by_contact : the same of this one's rate by that of MuJoCo's rollers; None where it did not run
    """

    name: str
    platforms: int
    rate: float
    ratio: float
    by_contact: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def simulators(settings: SimulatorSettings, platforms: int = 4096) -> list[Simulator]:
    """All in turns; MuJoCo only where it is installed."""
    model = load_model("paper")
    runs: dict[str, tuple[Callable[[int], Any], int]] = {
        "environment, batch: full": (_environment(platforms, "float64"), platforms),
        "environment, batch float32: full": (_environment(platforms, "float32"), platforms),
        "Plant, batch: bare": (_plant(model, platforms), platforms),
        "Plant, one: bare": (_plant(model, None), 1),
        "scipy solve_ivp, compiled rates: bare": (_solver(model, settings.tolerance), 1),
    }
    with contextlib.suppress(InputError):  # where the extra is not installed
        runs[CONTACT] = (_contact(model), 1)
    for run, _ in runs.values():
        run(2)
    seconds = np.empty((settings.rounds, len(runs)))
    for row in seconds:
        for column, (run, _) in enumerate(runs.values()):
            start = time.perf_counter()
            run(settings.steps)
            row[column] = time.perf_counter() - start
    counts = np.array([count for _, count in runs.values()])
    rates = settings.steps * PERIOD * counts / seconds
    middle, ratio = np.median(rates, axis=0), np.median(rates[:, :1] / rates, axis=0)
    slowest = list(runs).index(CONTACT) if CONTACT in runs else None
    return [
        Simulator(
            *(name, int(counts[k]), float(middle[k]), float(ratio[k])),
            None if slowest is None else float(np.median(rates[:, k] / rates[:, slowest])),
        )
        for k, name in enumerate(runs)
    ]


def _torques(count: int) -> np.ndarray:
    """(16, count, 4) [N m]: what drives all of them, in turn."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (16, count, 4))


def _environment(copies: int, dtype: str) -> Callable[[int], None]:
    envs = gym.make_vec(
        "youbot_env:YouBotTracking-v0",
        copies,
        vectorization_mode="vector_entry_point",
        threads=1,
        dtype=dtype,
        **FULL,
    )
    envs.reset(seed=0)
    actions = (_torques(copies) / 2.0).astype(np.float32)

    def run(steps: int) -> None:
        for step in range(steps):
            envs.step(actions[step % 16])

    return run


def _plant(model: Model, platforms: int | None) -> Callable[[int], None]:
    plant, torques = Plant(model, platforms=platforms), _torques(platforms or 1)
    given = torques if platforms else torques[:, 0]

    def run(steps: int) -> None:
        for step in range(steps):
            plant.step(given[step % 16], PERIOD)

    return run


def _contact(model: Model) -> Callable[[int], None]:
    from youbot_env.contact.plant import ContactPlant

    plant, torques = ContactPlant(model), _torques(1)[:, 0]

    def run(steps: int) -> None:
        for step in range(steps):
            plant.step(torques[step % 16], PERIOD)

    return run


def _solver(model: Model, tolerance: float) -> Callable[[int], None]:
    rates = derivative(model.structure)
    lengths, theta = np.array(model.lengths, float), np.array(model.theta, float)
    torques = _torques(1)[:, 0]
    state = initial_state(model)

    def run(steps: int) -> None:
        now = state
        for step in range(steps):
            torque = torques[step % 16]
            now = solve_ivp(
                lambda _, y, u=torque: rates(y, u, lengths, theta),
                (0.0, PERIOD),
                now,
                rtol=tolerance,
                atol=tolerance,
            ).y[:, -1]

    return run
