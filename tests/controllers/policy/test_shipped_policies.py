"""Shipped policies do on unseen references what their own records and the documents say."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.interface import Controller, Loop, Observation, Reference
from controllers.kinematic import KinematicControl
from controllers.policy.policy_file import load_policy, shipped_policies
from controllers.registry import build, build_policy
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_scripts.cli import main
from youbot_scripts.recording.named_motions import with_effects
from youbot_scripts.training.settings import TEST_SEED

PAPER = load_model("paper")
ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text("utf-8")
DOCUMENT = (ROOT / "docs/training.md").read_text("utf-8")
REFERENCES = 5


def environment(plant: Model, conditions: dict[str, Any]) -> YouBotTrackingEnv:
    known = {k: v for k, v in conditions.items() if not k.startswith("reward")}
    return YouBotTrackingEnv(plant, **known)


def errors(env: YouBotTrackingEnv, controller: Controller, references: int) -> np.ndarray:
    """(n, 3): rms of the true error over that of the reference, by reference and axis."""
    found = []
    for row in range(references):
        _, info = env.reset(seed=TEST_SEED + row)
        assert env.reference is not None
        ahead = env.reference.evaluate(env.period * np.arange(1100))
        controller.reset()
        error, wanted, over, now = [], [], False, 0
        while not over:
            observation = Observation(info["time"], info["wheel_speed"], info["measured_twist"])
            coming = slice(now + 1, now + 9)
            reference = Reference(
                info["reference_twist"],
                info["reference_acceleration"],
                ahead[0][coming],
                ahead[1][coming],
            )
            torque = controller(observation, reference)
            _, _, terminated, truncated, info = env.step(env.to_action(torque))
            over, now = terminated or truncated, now + 1
            error.append(info["tracking_error"])
            wanted.append(info["reference_twist"])
        ratio = np.square(error).mean(axis=0) / np.square(wanted).mean(axis=0)
        found.append(np.sqrt(ratio))
    return np.array(found)


def drives(name: str) -> tuple[YouBotTrackingEnv, Loop, dict[str, Any]]:
    record = dict(load_policy(name)[1].training)
    choice = record["choice"]
    env = environment(with_effects(PAPER, choice["effects"]), choice["conditions"])
    period = env.period
    loop = Loop(period, choice["conditions"]["delay"] * period, 0.5 * period)
    return env, loop, record


def test_there_is_one_that_drives_alone_and_one_on_top_of_computed_torque():
    bases = {name: load_policy(name)[1].base for name in shipped_policies()}
    assert None in bases.values() and "computed_torque" in bases.values()


@pytest.mark.parametrize("name", shipped_policies())
def test_it_does_what_its_record_says(name):
    env, loop, record = drives(name)
    policy = build_policy(name, PAPER, loop)
    found = errors(env, policy, REFERENCES)
    assert found.mean() == pytest.approx(record["test"][policy.description.name]["error"], rel=0.2)


@pytest.mark.parametrize("name", shipped_policies())
def test_it_beats_what_it_has_to(name):
    env, loop, record = drives(name)
    policy = build_policy(name, PAPER, loop)
    base = policy.description.base
    rival = build(base, PAPER, loop) if base else KinematicControl(sample_time=loop.sample_time)
    ours, theirs = errors(env, policy, 2), errors(env, rival, 2)
    assert 3 * ours.mean() < theirs.mean()
    assert (ours < theirs).all()


@pytest.mark.parametrize("name", shipped_policies())
def test_its_record_tells_how_to_train_it_again(name):
    record = load_policy(name)[1].training
    assert record["command"].startswith("youbot train ")
    assert record["cpu_time"] < 30 * 60
    assert {"python", "numpy", "torch", "stable-baselines3", "youbot"} <= set(record["versions"])
    steps = [row["steps"] for row in record["curve"]]
    assert steps == sorted(steps) and steps[-1] == record["steps"]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("ppo", "--model known"),
        ("residual_ppo", "--model paper --effect wheel_coulomb_friction:torque=0.15"),
    ],
)
def test_the_documents_show_what_evaluate_measures(name: str, options: str, tmp_path: Path):
    file = tmp_path / "found.json"
    wanted = f"--controllers {name} --bands 0.5-3 --seeds 20 --jobs 1 --json {file} {options}"
    assert main(["evaluate", *wanted.split()]) == 0
    (result,) = json.loads(file.read_text("utf-8"))["results"]
    found = [100 * result["metrics"][f"nrmse {axis}"]["mean"] for axis in ("VX", "VY", "W")]
    in_readme = re.search(rf"`{name}`: ([\d.]+)", README)
    assert in_readme, f"README has no figure of {name}"
    row = re.search(rf"^\| `{name}` .*$", DOCUMENT, re.MULTILINE)
    assert row, f"docs/training.md has no row for {name}"
    shown = [float(cell) for cell in re.findall(r"([\d.]+) %", row[0])]
    assert shown == pytest.approx([*found, np.mean(found)], abs=0.006)
    assert float(in_readme[1]) == pytest.approx(np.mean(found), abs=0.006)
    assert load_policy(name)[1].training["command"] in DOCUMENT
