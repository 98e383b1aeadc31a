"""After ``python -m youbot_env.precompile`` an environment's first step compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

COUNT = """
import gymnasium
from numba.core import event

class Compiled(event.Listener):
    count = 0
    def on_start(self, _): Compiled.count += 1
    def on_end(self, _): pass

event.register("numba:compile", Compiled())
env = gymnasium.make("youbot_env:YouBotTracking-v0", randomise={"m0": ("95%", "105%")})
env.reset(seed=0)
env.step(env.action_space.sample())
print(Compiled.count)
"""


@pytest.mark.slow
def test_the_first_environment_finds_all_compiled(tmp_path: Path) -> None:
    def run(cache: str, *arguments: str) -> str:
        folder = tmp_path / cache
        caches = {"YOUBOT_CACHE_DIR": str(folder / "k"), "NUMBA_CACHE_DIR": str(folder / "n")}
        done = subprocess.run(
            [sys.executable, *arguments],
            env=os.environ | caches | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout

    assert int(run("new", "-c", COUNT)) > 50
    said = run("filled", "-m", "youbot_env.precompile")
    assert said.startswith("compiling: environments in double precision")
    assert int(run("filled", "-c", COUNT)) == 0
