"""The script of docs/gpu.md learns; here with a batch of the processor in the GPU's place."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import youbot_env.gpu
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import Batch, keys_of
from youbot_env.tracking.options import tracking_setup

PAGE = Path(__file__).parents[3] / "docs" / "gpu.md"


class OnProcessor:
    """What a ``GpuBatch`` shows, in arrays of numpy."""

    def __init__(self, copies: int, **options: Any) -> None:
        setup = tracking_setup(**options)
        self._rows = Batch(setup, copies, autoreset=lanes.SAME_STEP, reports=False)
        self._copies = copies
        size = setup.task.observation_size
        self.observation = np.zeros((size, copies), np.float32)
        self.final_observation = np.zeros((size, copies), np.float32)
        self.reward, self.over = np.zeros(copies), np.zeros((2, copies), np.bool_)

    def reset(self, seed: int) -> np.ndarray:
        self._rows.begin(keys=keys_of(range(seed, seed + self._copies)))
        self.observation[:] = self._rows.observation.T
        return self.observation

    def step(self, action: Any) -> None:
        found = self._rows.step(np.ascontiguousarray(action.numpy()))
        self.observation[:], self.reward[:] = found.observation.T, found.reward
        self.over[:] = found.over
        if found.over.any():
            self.final_observation[:] = self._rows.final()[0].T


def test_its_rewards_rise(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr(youbot_env.gpu, "GpuBatch", OnProcessor)
    script = re.findall(r"```py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[-1]
    sizes = 'device, copies, length, updates = "cuda", 16384, 32, 200'
    assert sizes in script
    script = script.replace(sizes, 'device, copies, length, updates = "cpu", 256, 32, 30')
    exec(compile(script, str(PAGE), "exec"), {"__name__": "script"})
    rewards = [float(line.split()[-1]) for line in capsys.readouterr().out.splitlines()]
    assert np.mean(rewards[-3:]) > np.mean(rewards[:3]) + 0.03, rewards
