"""Controllers by name: every one is built, answers like a controller, and strangers are refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from controllers import registry
from controllers.interface import Controller, Loop, Observation, Reference
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

TWIST, AHEAD = np.array([0.2, -0.1, 0.3]), 40
REFERENCE = Reference(TWIST, np.zeros(3), np.tile(TWIST, (AHEAD, 1)), np.zeros((AHEAD, 3)))

GAINS = {"proportional": 0.5, "integral": 2.0}
DESIGNED = {"kinematic_tuned": GAINS, "kinematic_free": GAINS}
"""Settings of those whose design takes long, as a design would give them."""


def at_rest() -> Observation:
    return Observation(0.0, np.zeros(4), np.zeros(3), None, np.zeros(4))


@pytest.mark.parametrize("name", registry.CONTROLLERS)
def test_every_name_stands_for_a_controller(name: str):
    """It pushes a platform at rest towards the reference, within the limit, and can forget."""
    model, loop = load_model("paper"), Loop(torque_limit=1.5)
    controller = registry.build(name, model, loop, **DESIGNED.get(name, {}))
    assert isinstance(controller, Controller)
    assert 0 <= getattr(controller, "preview_needed", 0) <= AHEAD
    controller.reset()
    first = controller(at_rest(), REFERENCE)
    assert first.shape == (4,) and (np.abs(first) <= 1.5 + 1e-12).all()
    force = model.geometry.wheel_jacobian.T @ first
    assert (force * TWIST > 0).all()
    controller(at_rest(), REFERENCE)
    controller.reset()
    np.testing.assert_array_equal(controller(at_rest(), REFERENCE), first)
    # A lost measurement, of a wheel and so of the twist, must reach no drive, then or later.
    speed, twist = np.array([0.0, np.nan, 0.0, 0.0]), np.full(3, np.nan)
    for observation in (Observation(0.0, speed, twist, None, np.zeros(4)), at_rest(), at_rest()):
        assert np.isfinite(controller(observation, REFERENCE)).all()


FIRST_STEPS = """
import time
import numpy as np
from controllers import registry
from controllers.interface import Loop, Observation, Reference
from youbot_env.model.model_file import load_model

model = load_model("paper").with_effect("cable_drag", force=1.0)
adaptive = registry.build("adaptive", model, Loop(torque_limit=1.5))
rng, longest = np.random.default_rng(0), 0.0
for k in range(300):
    ahead = rng.uniform(-0.3, 0.3, (41, 3))
    reference = Reference(ahead[0], np.zeros(3), ahead[1:], np.zeros((40, 3)))
    observation = Observation(0.001 * k, rng.standard_normal(4), rng.uniform(-0.3, 0.3, 3))
    start = time.process_time()
    adaptive(observation, reference)
    longest = max(longest, time.process_time() - start)
print(longest)
"""


@pytest.mark.slow
def test_adaptive_has_compiled_all_that_it_needs_when_it_is_built(tmp_path: Path):
    """With no compiled code at hand no step takes long: compiling takes more than a second."""
    environment = {**os.environ, "YOUBOT_CACHE_DIR": str(tmp_path)}
    line = [sys.executable, "-c", FIRST_STEPS]
    done = subprocess.run(line, env=environment, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.05


@pytest.mark.parametrize("name", ["kinematik", "kinematic "])
def test_a_name_that_is_nearly_right_is_told_the_right_one(name: str):
    with pytest.raises(InputError, match="did you mean kinematic"):
        registry.entry(name)


def test_a_name_that_is_far_off_is_told_all():
    with pytest.raises(InputError, match="known are kinematic"):
        registry.entry("x")


def test_the_documents_list_every_name():
    text = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")
    shipped = text.split("## Your own")[0]
    listed = re.findall(r"^\| `(\w+)` \|", shipped, re.MULTILINE)
    assert listed == list(registry.CONTROLLERS)


def test_a_missing_extra_is_said_before_anything_is_computed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"'lqi'.*youbot\[control\]"):
        registry.check("lqi")
    for name in set(registry.CONTROLLERS) - {"lqi"}:
        registry.check(name)


def test_what_needs_an_extra_says_so(monkeypatch: pytest.MonkeyPatch):
    """The demo tells its story without python-control: kinematic_tuned is tried there."""
    monkeypatch.setitem(sys.modules, "control", None)
    model, loop = load_model("paper"), Loop(sample_time=0.01, delay=0.01)
    pid = registry.CONTROLLERS["pid"].design
    assert pid is not None and pid(model, loop)
    lqi = registry.CONTROLLERS["lqi"].design
    with pytest.raises(InputError):
        assert lqi is not None and lqi(model, loop)
