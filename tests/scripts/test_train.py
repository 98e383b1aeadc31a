"""`youbot train`: what it trains on, what it exports, and how a run is resumed."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controllers.interface import Observation, Reference
from controllers.kinematic import KinematicControl
from controllers.policy.inputs import plain_features, tracking_features
from controllers.policy.policy_file import load_policy
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.tracking.batch import keys_of
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_scripts.cli import main
from youbot_scripts.training.conditions import Conditions, ranges_from
from youbot_scripts.training.settings import changed, choice_from_dict, chosen

sb3 = pytest.importorskip("stable_baselines3")

from youbot_scripts.training import learning  # noqa: E402 - they need what is skipped for
from youbot_scripts.training.exporting import ALGORITHMS, network_of  # noqa: E402
from youbot_scripts.training.platforms import FeatureVecEnv, PlatformBatch, platform_setup  # noqa: E402
from youbot_scripts.training.run_folder import RunFolder  # noqa: E402
from youbot_scripts.training.trainee import (  # noqa: E402
    idle,
    prepare,  # noqa: E402
    track,
)

PAPER = load_model("paper")
SMALL = ["envs=4", "episode_length=0.5", "evaluations=2", "net_arch=[8]"]
QUICK = {
    "ppo": ["steps=512", "n_steps=32", "batch_size=64", "n_epochs=2"],
    "sac": ["steps=96", "learning_starts=16", "buffer_size=1000", "gradient_steps=2"],
    "td3": ["steps=96", "learning_starts=16", "buffer_size=1000", "gradient_steps=2"],
}
"""Runs of a second each: they learn nothing, but do all that a long one does."""


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """As in training: on a busy machine torch's threads wait for each other 20 times as long."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def quick(algorithm: str, **given):
    return chosen(algorithm, {**given, "set": [*SMALL, *QUICK[algorithm]]})[0]


def command(algorithm: str, *more: str) -> list[str]:
    settings = [word for text in (*SMALL, *QUICK[algorithm]) for word in ("--set", text)]
    return ["train", algorithm, *settings, *more]


def weights(path) -> np.ndarray:
    network, _ = load_policy(path)
    return np.concatenate([part.ravel() for layer in network.layers for part in layer])


# --- what is trained on ----------------------------------------------------------------------


def test_the_fleet_is_the_environment():
    conditions = Conditions(reward_margins={}, reward_weights={})
    fleet = PlatformBatch(platform_setup(conditions, PAPER, {"m0": ("80%", "120%")}), 3)
    fleet.begin(keys=keys_of(range(3)))
    env = YouBotTrackingEnv(
        delay=1, wheel_speed_noise=0.01, encoder_ticks=conditions.encoder_ticks,
        randomise={"m0": ("80%", "120%")},
    )  # fmt: skip
    seen, _ = env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1.5, 1.5, (100, 3, 4))
    for action in actions:
        assert np.array_equal(fleet.observe()[1], seen.astype(np.float64))
        fleet.step(action)
        seen, reward, *_ = env.step(np.clip(action[1], -1, 1))
        assert fleet.rows.reward[1] == reward


def vector(count: int = 5, length: float = 0.1, **options) -> FeatureVecEnv:
    setup = platform_setup(Conditions(episode_length=length, **options), PAPER)
    fleet = PlatformBatch(setup, count)
    return FeatureVecEnv(fleet, tracking_features(fleet.layout), np.eye(4), (0, 0))


def test_first_episodes_end_one_after_another_and_later_ones_last():
    env = vector()
    env.reset()
    ends = []
    for _ in range(30):
        seen, reward, done, infos = env.step(np.zeros((5, 4)))
        assert isinstance(seen, np.ndarray)
        ends.append(done.copy())
        for row in np.flatnonzero(done).tolist():
            info: Any = infos[row]
            assert info["TimeLimit.truncated"]
            assert not np.array_equal(info["terminal_observation"], seen[row])
            assert info["episode"]["r"] <= info["episode"]["l"]
    steps = [np.flatnonzero(column) + 1 for column in np.array(ends).T]
    assert sorted(column[0] for column in steps) == [2, 4, 6, 8, 10]
    assert {int(gap) for column in steps for gap in np.diff(column)} == {10}


def test_a_run_away_ends_at_once_and_is_no_time_out():
    env = vector(length=30.0, torque_limit=2000.0, amplitude=(0.0, 0.0, 0.0))
    env.reset()
    for _ in range(3000):
        _, _, done, infos = env.step(np.ones((5, 4)))
        if done.any():
            break
    assert not any(info["TimeLimit.truncated"] for info in infos if info)


def test_stable_baselines3_sees_the_features_that_the_policy_will():
    choice = quick("ppo")
    trainee = prepare(choice, PAPER)
    env = FeatureVecEnv(trainee.fleet(4), trainee.features, trainee.mix, (0, 0))
    seen = env.reset()
    model = ALGORITHMS["ppo"]("MlpPolicy", env, device="cpu", policy_kwargs={"net_arch": [8]})
    for _ in range(50):
        action, _ = model.predict(seen, deterministic=True)
        network = network_of(model, trainee.features, trainee.mix)
        ours = network.actions(env._fleet.observe())
        assert ours == pytest.approx(action @ trainee.mix.T, abs=1e-6)
        seen, *_ = env.step(np.random.default_rng(0).uniform(-1, 1, action.shape))


def test_a_controller_beneath_drives_as_it_would_alone():
    exact = Conditions(episode_length=3.0, wheel_speed_noise=0.0, encoder_ticks=None)
    setup = platform_setup(exact, PAPER)
    found = track(
        idle, setup, references=2, seed=7, make_base=lambda: KinematicControl(sample_time=0.01)
    )
    env = YouBotTrackingEnv(delay=1, episode_length=3.0)
    for row in range(2):
        _, info = env.reset(seed=7 + row)
        control, errors, wanted, over = KinematicControl(sample_time=0.01), [], [], False
        while not over:
            observation = Observation(info["time"], info["wheel_speed"], info["measured_twist"])
            reference = Reference(info["reference_twist"], info["reference_acceleration"])
            _, _, _, over, info = env.step(env.to_action(control(observation, reference)))
            errors.append(info["tracking_error"])
            wanted.append(info["reference_twist"])
        expected = np.sqrt(np.square(errors).mean(axis=0) / np.square(wanted).mean(axis=0))
        assert found.error[row] == pytest.approx(expected, rel=1e-9)
    assert found.mean > 0.3


# --- what comes out --------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_exported_is_what_stable_baselines3_predicts(algorithm, tmp_path):
    choice = quick(algorithm)
    trainee = prepare(choice, PAPER)
    model = learning._learner(trainee, 0, "cpu", None)
    model.learn(choice.learner.steps)
    network = network_of(model, trainee.features, trainee.mix)
    observations = np.random.default_rng(0).uniform(-0.5, 0.5, (500, trainee.features.shape[1]))
    seen = np.clip(observations @ trainee.features.T, -10, 10).astype(np.float32)
    expected, _ = model.predict(seen, deterministic=True)
    assert np.abs(expected).max() > 0
    assert network.actions(observations) == pytest.approx(
        expected.astype(float) @ trainee.mix.T, abs=1e-6
    )


def test_networks_that_are_not_plain_are_refused():
    model = ALGORITHMS["ppo"](
        "MlpPolicy", vector(), device="cpu", use_sde=True, policy_kwargs={"net_arch": [8]}
    )
    features = np.eye(15)
    with pytest.raises(InputError, match="only plain networks"):
        network_of(model, features, np.eye(4))


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_same_seed_same_weights_to_the_bit(algorithm, tmp_path):
    found = {}
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        folder = RunFolder(tmp_path / name)
        choice = quick(algorithm, seed=seed)
        folder.begin(choice, PAPER, "")
        learning.train(choice, PAPER, folder)
        found[name] = weights(folder.policy)
    assert np.array_equal(found["a"], found["b"])
    assert not np.array_equal(found["a"], found["c"])


class StopError(Exception):
    """Stands for Ctrl-C in the middle of a run."""


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_an_interrupted_run_continues_to_the_same_total(algorithm, tmp_path):
    choice, folder = quick(algorithm), RunFolder(tmp_path / "run")
    choice = replace(choice, learner=replace(choice.learner, evaluations=4))
    folder.begin(choice, PAPER, "")
    rows: list[dict] = []

    def stop(row):
        rows.append(row)
        if len(rows) == 2:
            raise StopError

    with pytest.raises(StopError):
        learning.train(choice, PAPER, folder, report=stop)
    state, replay = folder.load()
    assert state is not None and state["steps"] == rows[-1]["steps"]
    assert (replay is None) == (algorithm == "ppo")
    told: list[int] = []
    _, record = learning.train(choice, PAPER, folder, progress=lambda steps=1: told.append(steps))
    assert record["steps"] == record["curve"][-1]["steps"] >= choice.learner.steps
    assert record["curve"][:2] == rows
    steps = [row["steps"] for row in record["curve"]]
    assert steps == sorted(set(steps)) and len(steps) in (4, 5)
    assert sum(told) == record["steps"]
    again = learning.train(choice, PAPER, folder)[1]
    assert again["curve"] == record["curve"]


def test_the_best_policy_is_kept(tmp_path, monkeypatch):
    errors = iter([0.5, 0.2, 0.4, 0.9])
    choice, folder = quick("ppo"), RunFolder(tmp_path)
    choice = replace(choice, learner=replace(choice.learner, evaluations=4))

    class Found:
        def __init__(self):
            self.value = next(errors)

        def to_dict(self):
            return {"error": self.value, "error_by_axis": {}}

    kept = []
    monkeypatch.setattr("youbot_scripts.training.trainee.Trainee.judge", lambda *a: Found())
    learning.train(choice, PAPER, folder, report=lambda row: kept.append(weights(folder.policy)))
    assert not np.array_equal(kept[0], kept[1])
    assert np.array_equal(kept[1], kept[2]) and np.array_equal(kept[2], kept[3])


# --- the command -----------------------------------------------------------------------------


def test_the_command_trains_tests_and_resumes(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = command("ppo", "--seed", "5", "-o", "run", "--json", "r.json")
    assert main([*arguments, "--tensorboard"]) == 0
    printed = capsys.readouterr().out
    assert "kinematic" in printed and "run/policy.json" in printed
    result = json.loads((tmp_path / "r.json").read_text())
    record = result["training"]
    assert record["seed"] == 5 and record["command"].startswith("youbot train ppo --seed 5 --set")
    assert set(record["test"]) == {"kinematic", "ppo"} and record["test"]["ppo"]["error"] > 0
    assert len(record["curve"]) == 2 and record["wall_time"] > 0
    _, described = load_policy("run/policy.json")
    assert described.training["test"] == record["test"]
    assert list((tmp_path / "run" / "tensorboard").rglob("events*"))
    assert main(arguments) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert main(["train", "ppo", "--output", "run", "--resume"]) == 0
    assert main(["train", "ppo", "--output", "run", "--resume", "--seed", "1"]) == 2
    assert "leave out --seed" in capsys.readouterr().err
    assert main(["train", "sac", "--output", "run", "--resume"]) == 2
    assert "resume ppo" in capsys.readouterr().err


def test_on_top_of_a_controller(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = command("ppo", "--residual", "kinematic", "--share", "0.2", "--output", "run")
    assert main([*arguments, "--effect", "wheel_coulomb_friction:torque=0.15"]) == 0
    network, described = load_policy("run/policy.json")
    assert described.base == "kinematic" and described.share == 0.2
    assert described.layout.base_torque and network.features.shape == (22, 29)
    assert set(described.training["test"]) == {"kinematic", "ppo on kinematic"}


def test_importing_a_zip_warns_and_plays_alike(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    env = YouBotTrackingEnv(preview=2, action_history=2, episode_length=0.2)
    model = sb3.PPO("MlpPolicy", env, n_steps=20, batch_size=20, device="cpu")
    model.learn(20)
    model.save("own.zip")
    arguments = ["train", "ppo", "--import", "own.zip", "--output", "own"]
    assert main([*arguments, "--set", "action_history=2"]) == 0
    assert "runs whatever code" in capsys.readouterr().err
    network, described = load_policy("own/policy.json")
    assert (described.layout.preview, described.layout.action_history) == (2, 2)
    seen, _ = env.reset(seed=0)
    expected, _ = model.predict(seen, deterministic=True)
    assert network.actions(seen[None])[0] == pytest.approx(expected, abs=1e-6)
    assert main([*arguments, "--set", "action_history=3"]) == 2
    assert "20 inputs are not" in capsys.readouterr().err
    (tmp_path / "own.zip").write_bytes(b"nothing")
    assert main(arguments) == 2
    assert main(["train", "ppo", "--import", "none.zip", "--output", "own"]) == 2


QUICK_SETS = [word for text in (*SMALL, *QUICK["ppo"]) for word in ("--set", text)]

WRONG = {
    "unknown key": (["--set", "gama=0.9"], "did you mean 'gamma'"),
    "no assignment": (["--set", "gamma"], "key=value"),
    "kind": (["--set", "envs=many"], "cannot replace"),
    "value": (["--set", "n_steps=0", "--steps", "200"], "train ppo"),
    "diverges": (["--set", "learning_rate=1e9", *QUICK_SETS], "lower learning_rate"),
    "controller": (["--residual", "magic"], "controller 'magic'"),
    "policy beneath": (["--residual", "policy.json"], "is a policy itself"),
    "share alone": (["--share", "0.2"], "belongs to --residual"),
    "covariance": (["--randomise", "covariance"], "no covariance"),
    "range": (["--randomise", "m0"], "m0=90%:110%"),
    "range name": (["--randomise", "mass=1:2"], "unknown parameter 'mass'"),
    "effect": (["--effect", "glue:x=1"], "glue"),
    "model": (["--model", "none.json"], "none.json"),
    "nothing to resume": (["--resume"], "no run to resume"),
    "features": (["--set", "features=all"], "features is one of"),
    "band": (["--set", "band=[3,1]"], "band"),
    "reward": (["--set", "reward_margins.speed=1"], "unknown term 'speed'"),
    "device": (["--device", "abacus", "--steps", "200"], "train ppo"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_is_one_line_and_status_2(name, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, message = WRONG[name]
    assert main(["train", "ppo", *arguments, "--output", "run"]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not list(tmp_path.glob("run/policy*"))


def test_a_checkpoint_cannot_run_code(tmp_path, capsys, monkeypatch):
    import torch

    class Evil:
        def __reduce__(self):
            return open, (str(tmp_path / "ran"), "w")

    monkeypatch.chdir(tmp_path)
    RunFolder(tmp_path / "run").begin(quick("ppo"), PAPER, "")
    for content in ({"steps": 1, "evil": Evil()}, {"steps": 1}):
        torch.save(content, tmp_path / "run" / "checkpoint.pt")
        assert main(["train", "ppo", "--output", "run", "--resume"]) == 2
        assert "checkpoint" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


def test_settings_survive_their_file():
    choice = quick("sac", residual="kinematic", effect=["floor_tilt:tilt_x=0.01"], lag=0.03)
    assert choice_from_dict(json.loads(json.dumps(choice.to_dict()))).to_dict() == (
        json.loads(json.dumps(choice.to_dict())) | {"effects": ("floor_tilt:tilt_x=0.01",)}
    )


def test_set_reaches_every_kind_of_setting():
    choice = changed(
        quick("ppo"), ["gamma=0.5", "delay=3", "mixed=false", "reward_margins.yaw_rate=0.5"]
    )
    assert choice.learner.learning["gamma"] == 0.5 and choice.conditions.delay == 3
    assert not choice.learner.mixed
    assert choice.conditions.reward_margins["yaw_rate"] == 0.5
    assert choice.conditions.reward_margins["velocity_x"] == 0.02


def test_ranges():
    assert ranges_from("none", PAPER) is None and ranges_from("covariance", PAPER) == "covariance"
    assert ranges_from("m0=90%:110%, aX=-0.02:0.02", PAPER) == {
        "m0": ("90%", "110%"), "aX": (-0.02, 0.02)
    }  # fmt: skip
    auto = ranges_from("auto", PAPER)
    assert isinstance(auto, dict) and set(auto) == set(PAPER.values)
    names = tuple(PAPER.values)
    sure = replace(PAPER, covariance=1e-8 * np.eye(len(names)), covariance_names=names)
    assert ranges_from("auto", sure) == "covariance"
    drawn = platform_setup(Conditions(), sure, "covariance").source.draw(np.random.default_rng(0))
    assert drawn.values != PAPER.values
    assert drawn.values["m0"] == pytest.approx(PAPER.values["m0"], abs=1e-3)


def test_missing_libraries_are_named():
    code = (
        "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None\n"
        "from youbot_scripts.cli import main; sys.exit(main(['train', 'ppo']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "youbot[rl]" in done.stderr


@pytest.mark.slow
def test_ppo_learns_to_track_in_a_minute(tmp_path):
    choice, _ = chosen("ppo", {"steps": 300_000})
    folder = RunFolder(tmp_path)
    folder.begin(choice, PAPER, "")
    trainee, record = learning.train(choice, PAPER, folder)
    stock = trainee.judge_other("kinematic", PAPER, 50).mean
    assert min(row["error"] for row in record["curve"]) < stock / 20
    assert trainee.features.shape != plain_features(trainee.description.layout).shape
