"""Times of environments in one run: ours and Gymnasium's own, turn by turn, so that a busy machine
slows both."""

from __future__ import annotations

import itertools
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np

from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import INFO, Batch, keys_of
from youbot_env.tracking.options import tracking_setup

FULL = {
    "wheel_speed_noise": 0.01,
    "delay": 1,
    "randomise": {"m0": ("90%", "110%"), "mu1": ("80%", "120%")},
}
"""Options of the batches: noise, one sample of delay, a new model in each episode."""

EFFECTS: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("floor_tilt", {"tilt_x": 0.02, "tilt_y": -0.01}),
    ("quadratic_friction", {"coefficient": 0.005}),
    ("torque_gain_error", {"gain_fl": 0.05, "gain_br": -0.05}),
    ("roller_inertia", {"inertia": 5e-4}),
    ("actuator_lag", {"time_constant": 0.05}),
    ("wheel_coulomb_friction", {"torque": 0.1, "smoothing": 0.3}),
)
"""Effects in the order in which they are added; the last one is stiff: it needs finer steps."""


@dataclass(frozen=True)
class SpeedSettings:
    """How times are measured."""

    rounds: int = field(
        default=21,
        metadata={"unit": "1", "reason": "medians of many short turns stand a busy machine"},
    )
    steps: int = field(
        default=40_000,
        metadata={"unit": "env steps a turn", "reason": "a few ms: less than a scheduler's slice"},
    )
    most_calls: int = field(
        default=2000,
        metadata={"unit": "calls a turn", "reason": "a few copies take as long a call as one"},
    )
    warm_up: int = field(
        default=50,
        metadata={"unit": "steps", "reason": "caches are filled, results' arrays are made"},
    )


@dataclass(frozen=True)
class Speed:
    """One row of the result.

    Attributes
    ----------
    case, copies, threads, effects : what was measured; "float32" batches are in single precision
    rate, peer_rate : env steps a second; of the peer in the same turns
    ratio : median over turns of the peer's time by ours: above 1 ours is faster
    bytes_a_copy : memory between steps
    """

    case: str
    copies: int
    threads: int
    effects: int
    rate: float
    peer_rate: float
    ratio: float
    bytes_a_copy: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def in_turns(
    ours: Callable[[], Any], peer: Callable[[], Any], calls: int, settings: SpeedSettings
) -> tuple[float, float, float]:
    """Median seconds a call of both, and the median over turns of the peer's by ours."""
    for function in (ours, peer):
        for _ in range(settings.warm_up):
            function()
    times = np.empty((settings.rounds, 2))
    for row in times:
        for column, function in enumerate((ours, peer)):
            start = time.perf_counter()
            for _ in range(calls):
                function()
            row[column] = (time.perf_counter() - start) / calls
    mine, theirs = np.median(times, axis=0)
    return float(mine), float(theirs), float(np.median(times[:, 1] / times[:, 0]))


def single(settings: SpeedSettings, peer_id: str = "CartPole-v1") -> Speed:
    """``env.step`` of one environment beside one of Gymnasium's, both through ``gym.make``."""
    ours, peer = gym.make("youbot_env:YouBotTracking-v0"), gym.make(peer_id)
    action = np.full(4, 0.1, np.float32)
    pushes = [0, 1] if peer_id == "CartPole-v1" else [np.full(1, u, np.float32) for u in (-1, 1)]
    turn = itertools.cycle(pushes)

    def drive() -> None:
        *_, terminated, truncated, _ = ours.step(action)
        if terminated or truncated:
            ours.reset()

    def balance() -> None:
        *_, terminated, truncated, _ = peer.step(next(turn))
        if terminated or truncated:
            peer.reset()

    ours.reset(seed=0)
    peer.reset(seed=0)
    mine, theirs, ratio = in_turns(drive, balance, min(500, settings.most_calls), settings)
    return Speed(f"one, {peer_id[:-3]}", 1, 1, 0, 1 / mine, 1 / theirs, ratio)


def batch(
    copies: int, threads: int, effects: int, settings: SpeedSettings, dtype: str = "float64"
) -> Speed:
    """The vector environment beside Gymnasium's NumPy CartPole of as many copies.

    Its copies stand at different times of their episodes, so that some begin a new one in most
    steps, as they do after long.
    """
    added = {name: dict(values) for name, values in EFFECTS[:effects]}
    mode = "vector_entry_point"
    ours: Any = gym.make_vec(
        "youbot_env:YouBotTracking-v0",
        copies,
        vectorization_mode=mode,
        threads=threads,
        effects=added,
        dtype=dtype,
        **FULL,
    )
    peer = gym.make_vec("CartPole-v1", copies, vectorization_mode=mode)
    rng = np.random.default_rng(0)
    action = rng.uniform(-1, 1, (copies, 4)).astype(np.float32)
    push = rng.integers(0, 2, copies)
    ours.reset(seed=0)
    peer.reset(seed=0)
    rows = ours.unwrapped.rows
    rows.set_clock(np.arange(copies) * rows.setup.steps // copies)
    calls = max(1, min(settings.steps // copies, settings.most_calls))
    mine, theirs, ratio = in_turns(
        lambda: ours.step(action), lambda: peer.step(push), calls, settings
    )
    rates = copies / mine, copies / theirs
    memory = ours.unwrapped.bytes_a_copy
    name = "batch" if dtype == "float64" else f"batch {dtype}"
    return Speed(name, copies, threads, effects, *rates, ratio, memory)


def speeds(
    copies: Sequence[int], threads: Sequence[int], effects: Sequence[int], settings: SpeedSettings
) -> list[Speed]:
    """One environment; numbers of copies and threads; of effects; single precision."""
    found = [single(settings, "CartPole-v1"), single(settings, "Pendulum-v1")]
    found += [batch(n, many, 0, settings) for n in copies for many in threads]
    largest = 8192 if 8192 in copies else copies[-1]
    found += [batch(largest, threads[-1], count, settings) for count in effects if count]
    return found + [batch(n, many, 0, settings, "float32") for n in copies for many in threads]


def single_precision_errors(copies: int = 16) -> dict[str, float]:
    """Largest differences of single from double precision over an episode of random torques."""
    setups = [tracking_setup(**FULL, dtype=dtype) for dtype in ("float64", "float32")]
    double, short = (Batch(setup, copies) for setup in setups)
    for rows in (double, short):
        rows.begin(keys=keys_of(range(copies)))
    rng, found = np.random.default_rng(0), np.zeros(lanes.REPORT_COLUMNS)
    for _ in range(setups[0].steps):
        action = rng.uniform(-1, 1, (copies, 4)).astype(np.float32)
        one, other = double.step(action).report, short.step(action).report
        found = np.maximum(found, np.abs(one - other).max(axis=0))
    names = ("twist", "pose", "wheel_angle", "reference_twist", "measured_twist")
    errors = {name: float(found[INFO[name]].max()) for name in names}
    return {**errors, "reward": float(found[lanes.REWARD_AT])}


def import_times(modules: Sequence[str], repeats: int = 5) -> dict[str, float]:
    """Median seconds of a new Python that imports a module, less one that imports nothing."""

    def seconds(code: str) -> float:
        times = []
        for _ in range(repeats):
            start = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
            times.append(time.perf_counter() - start)
        return float(np.median(times))

    bare = seconds("pass")
    found = {name: seconds(f"import {name}") - bare for name in modules}
    made = "import gymnasium; e = gymnasium.make('youbot_env:YouBotTracking-v0'); e.reset(seed=0)"
    return {**found, "gym.make and reset": seconds(made) - bare}


def machine() -> dict[str, Any]:
    """Machine and versions that the times belong to."""
    from importlib.metadata import version

    names = ("youbot", "numpy", "numba", "gymnasium")
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0,
        "load": os.getloadavg() if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "versions": {name: version(name) for name in names},
    }
