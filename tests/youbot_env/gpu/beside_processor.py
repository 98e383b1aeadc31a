"""A GPU's batch, in numba's CUDA simulator, beside the processor's: differences as JSON.

A process of its own runs it, since numba reads the environment variable that asks for the
simulator when it is imported: ``NUMBA_ENABLE_CUDASIM=1 python beside_processor.py CASE DTYPE``.
"""

from __future__ import annotations

import json
import sys

import numpy as np

from youbot_env.gpu.batch import GpuBatch
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import Batch, keys_of
from youbot_env.tracking.options import tracking_setup

SIX = {
    "floor_tilt": {"tilt_x": 0.02},
    "quadratic_friction": {"coefficient": 0.005},
    "torque_gain_error": {"gain_fl": 0.05},
    "roller_inertia": {"inertia": 5e-4},
    "actuator_lag": {"time_constant": 0.05},
    "wheel_coulomb_friction": {"torque": 0.1, "smoothing": 0.3},
}
CASES = {
    "usual": {
        "wheel_speed_noise": 0.01,
        "delay": 1,
        "randomise": {"m0": ("90%", "110%"), "mu1": ("80%", "120%")},
    },
    "counts": {"encoder_ticks": 4096, "preview": 3, "action_history": 2},
    "late": {"effects": {"torque_delay": {"delay": 0.013}}, "wheel_speed_noise": 0.02},
    "six": {"effects": SIX, "randomise": {"m0": ("90%", "110%")}},
}


def differences(case: str, dtype: str, copies: int = 3, steps: int = 13) -> dict[str, float]:
    """The largest ones over some steps, in which each copy begins a second episode."""
    options = {"episode_length": 0.1, **CASES[case]}
    ours = GpuBatch(copies, dtype=dtype, **options)
    other = Batch(
        tracking_setup(**options, dtype=dtype), copies, autoreset=lanes.SAME_STEP, reports=False
    )
    other.begin(keys=keys_of(range(7, 7 + copies)))
    shown = ours.reset(seed=7).copy_to_host().T
    found = {"start": float(np.abs(shown - other.observation).max())}
    rng, apart = np.random.default_rng(0), np.zeros(3)
    ended = 0
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, (copies, 4)).astype(np.float32)
        observation, reward, *_ = ours.step(action)
        expected = other.step(action)
        apart[0] = max(apart[0], np.abs(observation.copy_to_host().T - expected.observation).max())
        apart[1] = max(apart[1], np.abs(reward.copy_to_host() - expected.reward).max())
        assert np.array_equal(ours.over.copy_to_host(), expected.over)
        if expected.over.any():
            ended += 1
            last, _ = other.final()
            apart[2] = np.abs(ours.final_observation.copy_to_host().T - last).max()
    found |= dict(zip(("observation", "reward", "final"), apart.tolist(), strict=True))
    return {**found, "ended": ended}


if __name__ == "__main__":
    print(json.dumps(differences(sys.argv[1], sys.argv[2])))
