"""Controllers by name: every one is built, answers like a controller, and strangers are refused."""

from __future__ import annotations

import re
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
    """It accelerates a platform at rest towards the reference, within the limit, and forgets."""
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


@pytest.mark.parametrize("name", ["kinematik", "kinematic "])
def test_a_name_that_is_nearly_right_is_told_the_right_one(name: str):
    with pytest.raises(InputError, match="did you mean kinematic"):
        registry.entry(name)


def test_a_name_that_is_far_off_is_told_all():
    with pytest.raises(InputError, match="known are kinematic"):
        registry.entry("x")


def test_the_documents_list_every_name():
    text = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")
    listed = re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)
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
