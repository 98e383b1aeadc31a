"""Models, states and runs that the torch module is tested on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import drive, random_instant, state_of
from youbot_env import Model, initial_state, load_model, to_torch

torch: Any = pytest.importorskip("torch")

COUNT = 7
TWIST = (0.3, -0.2, 0.4)
TILTED = load_model("paper").with_effect("floor_tilt", tilt_x=0.02, tilt_y=-0.01)
LATE = load_model("paper").with_effect("torque_delay", delay=0.037)


def instants(m: Model) -> tuple[Any, Any]:
    """States (COUNT, S) and torques (COUNT, 4) within the platform's range."""
    at = random_instant(np.random.default_rng(5), COUNT)
    states = np.array([np.broadcast_to(v, COUNT) for v in state_of(m.structure, at)]).T
    return torch.tensor(states), torch.tensor(np.array(at.torque).T)


def course(m: Model, samples: int = 11, period: float = 0.02) -> tuple[Any, Any]:
    """A first state (S,) and torques (N, 4) for a run."""
    torque = drive(period * np.arange(samples))
    return torch.tensor(initial_state(m, twist=TWIST)), torch.tensor(torque)


def to_torch_at(m: Model, name: str, value: float) -> Any:
    """A platform with one parameter elsewhere, out of bounds if need be."""
    platform = to_torch(m)
    with torch.no_grad():
        platform.get_parameter(name).fill_(value)
    return platform
