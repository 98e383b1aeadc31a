"""Policies: what they see, what they play, and which files are refused."""

from __future__ import annotations

import hashlib
import io
import json
import pickle
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy as safetensors

from controllers.interface import Controller, Loop, Observation, Reference
from controllers.kinematic import KinematicControl
from controllers.policy.inputs import (
    WHEEL_MIX,
    Layout,
    plain_features,
    tracking_features,
    wheel_mix,
)
from controllers.policy.policy import Description, Network, Policy
from controllers.policy.policy_file import MAX_WEIGHTS, load_policy, save_policy, shipped_policies
from controllers.registry import build_policy
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import Geometry
from youbot_env.tracking.env import YouBotTrackingEnv
from youbot_env.tracking.task import twist_scale

SCALE = tuple(twist_scale(Geometry()).tolist())


def network(layout: Layout, seed: int = 0, gain: float = 0.3, **options) -> Network:
    rng = np.random.default_rng(seed)
    features = tracking_features(layout)
    sizes = (len(features), 8, 6, 3)
    layers = [
        (gain * rng.standard_normal((n, m)).astype(np.float32), rng.random(n).astype(np.float32))
        for m, n in zip(sizes, sizes[1:], strict=False)
    ]
    return Network(features, layers, WHEEL_MIX, **options)


def policy(seed: int = 0, **layout) -> Policy:
    described = Description("trial", Layout(SCALE, **layout))
    return Policy(network(described.layout, seed), described)


def seen_by_environment(env: YouBotTrackingEnv, info) -> tuple[Observation, Reference]:
    ahead = info["time"] + env.period * np.arange(1, 8)
    assert env.reference is not None
    observation = Observation(info["time"], info["wheel_speed"], info["measured_twist"])
    twist, acceleration = env.reference.evaluate(ahead)
    return observation, Reference(
        info["reference_twist"], info["reference_acceleration"], twist, acceleration
    )


@pytest.mark.parametrize("layout", [{}, {"preview": 0}, {"preview": 3, "action_history": 3}])
def test_sees_what_the_environment_observes(layout):
    env = YouBotTrackingEnv(
        wheel_speed_noise=0.01, encoder_ticks=103_352, delay=1, torque_limit=2.0, **layout
    )
    trial = policy(**layout)
    described = replace(trial.description, torque_limit=2.0)
    trial = Policy(trial.network, described)
    observation, info = env.reset(seed=3)
    for _ in range(200):
        expected = trial.network.actions(observation[None])[0]
        torque = trial(*seen_by_environment(env, info))
        assert torque / 2.0 == pytest.approx(np.clip(expected, -1, 1), abs=2e-5)
        observation, *_, info = env.step(env.to_action(torque))


def test_layout_counts_what_it_lays_out():
    for preview, history, base in ((5, 1, False), (0, 1, True), (3, 2, True)):
        layout = Layout(SCALE, preview, history, base)
        ahead = np.ones((preview, 3))
        seen = np.full(layout.size, np.nan)
        layout.fill(
            seen,
            Observation(0.0, np.zeros(4), np.ones(3)),
            Reference(np.ones(3), np.zeros(3), ahead),
            np.zeros(4 * history),
            np.zeros(4) if base else None,
        )
        assert np.isfinite(seen).all() and layout.divisors.shape == (layout.size,)
        assert plain_features(layout).shape == (layout.size, layout.size)
        assert tracking_features(layout).shape[1] == layout.size


def test_features_are_error_twist_slope_and_curvature():
    layout = Layout((1.0, 1.0, 1.0), preview=4)
    time_ahead = np.arange(5.0)
    twists = np.outer(0.1 + 0.02 * time_ahead + 0.003 * time_ahead**2, [1.0, -1.0, 2.0])
    action = WHEEL_MIX @ [0.1, 0.2, 0.3]
    seen = np.concatenate([twists[0] - 0.01, twists.ravel(), action])
    features = tracking_features(layout) @ seen
    assert features[0:3] == pytest.approx(30 * 0.01 * np.ones(3))
    assert features[3:6] == pytest.approx(4 * twists[0])
    assert features[6:9] == pytest.approx(250 * (twists[4] - twists[0]) / 4)
    second_difference = 2 * 0.003 * np.array([1.0, -1.0, 2.0])
    assert features[9:12] == pytest.approx(500 * second_difference * 2)
    assert features[12:15] == pytest.approx([0.4, 0.8, 1.2])


def test_on_top_of_a_controller_the_wheels_speeds_are_features():
    layout, geometry = Layout(SCALE, base_torque=True), Geometry()
    twist = np.array([0.01, 0.02, -0.03])
    seen = np.zeros(layout.size)
    seen[3:6] = twist / SCALE
    found = tracking_features(layout, geometry.L) @ seen
    expected = 50 * geometry.R * geometry.wheel_speeds(twist)
    assert found[12:16] == pytest.approx(expected)


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("squashed", [False, True])
def test_layers_are_evaluated_one_after_another(activation, squashed):
    found = network(Layout(SCALE), activation=activation, squashed=squashed)
    seen = np.random.default_rng(1).uniform(-0.3, 0.3, (5, 25))
    value = np.clip(seen @ found.features.T, -10, 10)
    for weight, bias in found.layers[:-1]:
        value = value @ weight.T + bias
        value = np.tanh(value) if activation == "tanh" else np.maximum(value, 0)
    weight, bias = found.layers[-1]
    value = value @ weight.T + bias
    value = np.tanh(value) if squashed else np.clip(value, -1, 1)
    assert found.actions(seen) == pytest.approx(value @ WHEEL_MIX.T, abs=3e-6)


def instant(**changes) -> tuple[Observation, Reference]:
    observation = Observation(0.0, np.zeros(4), np.array([0.1, 0.0, 0.2]))
    reference = Reference(np.array([0.2, 0.1, 0.0]), np.zeros(3), np.full((5, 3), 0.2))
    return observation._replace(**changes), reference


def test_remembers_its_last_action_until_reset():
    trial = policy()
    assert isinstance(trial, Controller)
    first, second = trial(*instant()), trial(*instant())
    assert not np.array_equal(first, second)
    trial.reset()
    assert np.array_equal(first, trial(*instant()))


def test_nan_counts_as_zero_and_leaves_nothing_behind():
    trial, twin = policy(), policy()
    bad = trial(*instant(body_twist=np.array([np.nan, 0.0, 0.2])))
    good = twin(*instant(body_twist=np.array([0.0, 0.0, 0.2])))
    assert np.array_equal(bad, good)
    assert np.array_equal(trial(*instant()), twin(*instant()))


def test_never_asks_for_more_than_the_limit():
    described = Description("trial", Layout(SCALE), torque_limit=2.0)
    loud = Policy(network(described.layout, gain=20.0), described, torque_limit=0.5)
    rng = np.random.default_rng(0)
    torques = [loud(*instant(body_twist=rng.standard_normal(3))) for _ in range(50)]
    assert np.abs(torques).max() == 0.5


def test_a_reference_that_is_too_short_is_refused():
    trial = policy()
    observation, reference = instant()
    for preview in (None, np.zeros((4, 3))):
        with pytest.raises(InputError, match="5 samples ahead"):
            trial(observation, reference._replace(preview=preview))
    assert trial.preview_needed == 5


def resting(base: Controller, share: float = 0.3) -> Policy:
    layout = Layout(SCALE, base_torque=True)
    described = Description("resting", layout, base="kinematic", share=share)
    return Policy(network(layout), described, base)


def test_on_top_of_a_controller_it_adds_no_more_than_its_share():
    rng, base = np.random.default_rng(0), KinematicControl(sample_time=0.01)
    trial, twin = resting(KinematicControl(sample_time=0.01)), base
    limit = trial.description.torque_limit
    for _ in range(50):
        observation, reference = instant(wheel_speed=5 * rng.standard_normal(4))
        torque, alone = trial(observation, reference), twin(observation, reference)
        assert np.abs(torque).max() <= limit
        assert np.abs(torque - alone).max() <= 3 * 0.3 * limit + 1e-12
        assert not np.array_equal(torque, alone)
    trial.reset()
    base.reset()
    silent = resting(KinematicControl(sample_time=0.01), share=1e-12)
    assert silent(*instant()) == pytest.approx(base(*instant()), abs=1e-9)


def test_needs_the_controller_that_it_was_trained_on():
    layout = Layout(SCALE, base_torque=True)
    with pytest.raises(InputError, match="sits on kinematic"):
        Policy(network(layout), Description("x", layout, base="kinematic"))
    with pytest.raises(InputError, match="drives alone"):
        Policy(network(Layout(SCALE)), Description("x", Layout(SCALE)), KinematicControl())


Saved = tuple[Path, Path]
"""Description and weights of a policy on disk."""

Damage = Callable[[Saved], Any]


@pytest.fixture
def saved(tmp_path) -> Saved:
    trial = policy()
    described = replace(trial.description, training={"seed": 3, "nan": float("nan")})
    return save_policy(tmp_path / "trial.json", trial.network, described)


def test_what_was_saved_is_loaded_to_the_bit(saved, tmp_path):
    found, described = load_policy(saved[0])
    trial = policy()
    assert described.layout == trial.description.layout
    assert described.training == {"seed": 3, "nan": None}
    seen = np.random.default_rng(0).uniform(-1, 1, (20, 25))
    assert np.array_equal(found.actions(seen), trial.network.actions(seen))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "trial.json",
        "trial.safetensors",
    ]


def test_a_file_on_top_of_a_controller_is_built_with_it(tmp_path):
    trial = resting(KinematicControl())
    path, _ = save_policy(tmp_path / "r.json", trial.network, trial.description)
    built = build_policy(path, load_model("paper"), Loop())
    assert isinstance(built.base, KinematicControl)
    assert built(*instant()) == pytest.approx(
        resting(KinematicControl(sample_time=0.01))(*instant())
    )


@pytest.mark.parametrize("base", ["r", "r.json", "../r.json", "magic"])
def test_a_policy_sits_on_a_controller_alone(tmp_path, monkeypatch, base):
    monkeypatch.chdir(tmp_path)
    trial = resting(KinematicControl())
    save_policy("r.json", trial.network, replace(trial.description, base=base))
    with pytest.raises(InputError, match="which is none of kinematic"):
        build_policy("r.json", load_model("paper"), Loop())


def in_o() -> Model:
    return replace(load_model("paper"), geometry=Geometry(l=0.15, h=0.25, arrangement="O"))


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_is_refused_on_rollers_in_o(name):
    """There the wheels that push sideways are others: it would drive to the wrong side."""
    with pytest.raises(InputError) as caught:
        build_policy(name, in_o(), Loop())
    assert str(caught.value).endswith(
        "was trained on a robot with rollers in X, these stand in O; train one on it: "
        "youbot train ppo --model MODEL"
    )


def test_one_that_was_trained_in_o_drives_there_alone(tmp_path, saved):
    network, description = load_policy(saved[0])
    path, _ = save_policy(tmp_path / "o.json", network, replace(description, rollers="O"))
    assert load_policy(path)[1].rollers == "O"
    assert build_policy(path, in_o(), Loop()).description.rollers == "O"
    with pytest.raises(InputError, match="rollers in O, these stand in X"):
        build_policy(path, load_model("paper"), Loop())


def test_wheels_are_mixed_as_a_robots_own_rollers_stand():
    assert np.array_equal(wheel_mix(Geometry()), WHEEL_MIX)
    geometry = in_o().geometry
    push = geometry.body_force(wheel_mix(geometry).T)
    assert np.abs(push - np.diag(np.diag(push))).max() < 1e-12 and (np.diag(push) > 0).all()


def test_another_control_rate_is_refused(saved):
    with pytest.raises(InputError, match="trained at 100 Hz, the loop runs at 500 Hz"):
        build_policy(saved[0], load_model("paper"), Loop(sample_time=0.002))


def as_npz(saved: Saved) -> Saved:
    """The same policy as older versions wrote it."""
    path, weights = saved
    arrays = safetensors.load(weights.read_bytes())
    weights.unlink()
    old = path.with_suffix(".npz")
    rehash((path, old), npz(arrays))
    return path, old


def npz(arrays: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


class Evil:
    """Leaves a file if it is ever unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return open, (str(self.mark), "w")


def swap(saved: Saved, **changes: Any) -> None:
    """Change arrays, and the description's hash with them; None removes one."""
    path, weights = saved
    if weights.suffix == ".npz":
        with np.load(weights) as held:
            arrays = {name: held[name] for name in held.files}
    else:
        arrays = safetensors.load(weights.read_bytes())
    kept = {key: value for key, value in (arrays | changes).items() if value is not None}
    rehash(saved, npz(kept) if weights.suffix == ".npz" else safetensors.save(kept))


def rehash(saved: Saved, content: bytes) -> None:
    path, weights = saved
    weights.write_bytes(content)
    edit(path, weights_sha256=hashlib.sha256(content).hexdigest())


def header(change: Callable[[dict[str, Any]], Any]) -> Damage:
    """Change what a safetensors file says of its arrays."""

    def damage(saved: Saved) -> None:
        content = saved[1].read_bytes()
        size = int.from_bytes(content[:8], "little")
        told = json.loads(content[8 : 8 + size])
        change(told)
        text = json.dumps(told).encode()
        rehash(saved, len(text).to_bytes(8, "little") + text + content[8 + size :])

    return damage


def raw(change: Callable[[bytes], bytes]) -> Damage:
    return lambda saved: rehash(saved, change(saved[1].read_bytes()))


def overlapping(told: dict[str, Any]) -> None:
    told["bias_0"]["data_offsets"] = told["bias_1"]["data_offsets"]


def huge(told: dict[str, Any]) -> None:
    told["bias_0"]["shape"] = [2**40, 2**40]


def edit(path, **changes) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def nested(key: str, **changes):
    def change(saved):
        edit(saved[0], **{key: {**json.loads(saved[0].read_text())[key], **changes}})

    return change


def bomb(saved) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("features.npy", bytes(MAX_WEIGHTS + 1))
    rehash(saved, stream.getvalue())


def pickled(saved) -> None:
    evil = np.array([Evil(saved[0].with_name("ran"))], object)
    swap(saved, bias_0=evil)


UNREADABLE = "not a safetensors file"

BROKEN_NPZ: dict[str, tuple[Damage, str]] = {
    "pickled": (pickled, "could run code"),
    "bomb": (bomb, "unpacks to more"),
    "no zip": (lambda s: rehash(s, b"weights"), "not an npz"),
}

BROKEN_WEIGHTS: dict[str, tuple[Damage, str]] = {
    "a bit flipped": (lambda s: s[1].write_bytes(s[1].read_bytes()[:-1] + b"x"), "sha256"),
    "too large": (lambda s: s[1].write_bytes(bytes(MAX_WEIGHTS + 1)), "larger than"),
    "NaN": (lambda s: swap(s, bias_0=np.full(8, np.nan, np.float32)), "bias_0 holds NaN"),
    "shape": (lambda s: swap(s, bias_1=np.zeros(5, np.float32)), r"bias_1 is float32 \(5,\)"),
    "dtype": (lambda s: swap(s, bias_1=np.zeros(6)), "bias_1 is float64"),
    "array missing": (lambda s: swap(s, mix=None), "'mix' is missing"),
    "array unknown": (lambda s: swap(s, extra=np.zeros(2)), "'extra' is not known"),
}

BROKEN: dict[str, tuple[Damage, str]] = {
    **BROKEN_WEIGHTS,
    "empty": (raw(lambda content: b""), UNREADABLE),
    "cut in its header": (raw(lambda content: content[:50]), UNREADABLE),
    "cut in its numbers": (raw(lambda content: content[:-3]), UNREADABLE),
    "more behind": (raw(lambda content: content + bytes(8)), UNREADABLE),
    "header beyond the end": (raw(lambda c: (1 << 20).to_bytes(8, "little") + c[8:]), UNREADABLE),
    "header of 2^63": (raw(lambda c: (1 << 63).to_bytes(8, "little") + c[8:]), UNREADABLE),
    "header no JSON": (raw(lambda c: c[:8] + b"x" + c[9:]), UNREADABLE),
    "arrays overlap": (header(overlapping), UNREADABLE),
    "a huge array": (header(huge), UNREADABLE),
    "unknown type": (header(lambda told: told["bias_0"].update(dtype="C128")), UNREADABLE),
    "type that numpy lacks": (
        header(lambda told: told["bias_0"].update(dtype="BF16", shape=[16])),
        f"{UNREADABLE}|bias_0 is",  # which of the two depends on what else is installed
    ),
    "pickled": (lambda s: rehash(s, pickle.dumps(Evil(s[0].with_name("ran")))), UNREADABLE),
    "an npz by the new name": (lambda s: rehash(s, npz({"mix": np.eye(4)})), UNREADABLE),
    "no weights": (lambda s: s[1].unlink(), "cannot be read"),
    "no JSON": (lambda s: s[0].write_text("{"), "not valid JSON"),
    "no object": (lambda s: s[0].write_text("[1]"), "must be a JSON object"),
    "deep": (lambda s: s[0].write_text("[" * 100_000), "not valid JSON"),
    "version": (lambda s: edit(s[0], schema_version=2), "schema_version is 2"),
    "key unknown": (lambda s: edit(s[0], extra=1), "unknown key 'extra'"),
    "layers": (nested("network", layers=[15]), "network.layers"),
    "huge layers": (nested("network", layers=[15, 10**12, 3]), "network.layers"),
    "activation": (nested("network", activation="exec"), "activation"),
    "preview": (nested("observation", preview=-1), "observation.preview"),
    "scale": (nested("observation", twist_scale=[1, 1, 0]), "twist_scale"),
    "limit": (nested("action", torque_limit=True), "torque_limit"),
    "share": (nested("action", share=2.0), "share"),
    "rate": (nested("action", control_rate=float("nan")), "control_rate"),
    "base": (lambda s: edit(s[0], base="pid"), "base_torque"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_refused_with_one_line(saved, name):
    damage, message = BROKEN[name]
    damage(saved)
    with pytest.raises(InputError, match=message) as caught:
        load_policy(saved[0])
    assert "\n" not in str(caught.value) and str(saved[0].parent) in str(caught.value)
    assert not saved[0].with_name("ran").exists()


@pytest.mark.parametrize("name", BROKEN_NPZ | BROKEN_WEIGHTS)
def test_broken_weights_of_older_versions_are_refused_with_one_line(saved, name):
    damage, message = (BROKEN_NPZ | BROKEN_WEIGHTS)[name]
    old = as_npz(saved)
    damage(old)
    with pytest.raises(InputError, match=message) as caught:
        load_policy(old[0])
    assert "\n" not in str(caught.value) and str(old[0].parent) in str(caught.value)
    assert not old[0].with_name("ran").exists()


def test_weights_of_older_versions_are_read_to_the_bit(saved):
    now, described = load_policy(saved[0])
    before, same = load_policy(as_npz(saved)[0])
    assert same == described
    for new, old in zip(now.layers, before.layers, strict=True):
        assert all(a.tobytes() == b.tobytes() for a, b in zip(new, old, strict=True))
    assert now.features.tobytes() == before.features.tobytes()
    assert now.mix.tobytes() == before.mix.tobytes()


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match="no shipped policy"):
        load_policy("no_such_policy")
    with pytest.raises(InputError, match="ends in .json"):
        save_policy("policy.npz", policy().network, policy().description)


def test_plays_where_neither_torch_nor_stable_baselines3_is(saved):
    code = (
        "import sys\n"
        "for name in ('torch', 'stable_baselines3', 'gymnasium'): sys.modules[name] = None\n"
        "import numpy as np\n"
        "from controllers.interface import Loop, Observation, Reference\n"
        "from controllers.registry import build_policy\n"
        "from youbot_env import load_model\n"
        f"p = build_policy({str(saved[0])!r}, load_model('paper'), Loop())\n"
        "o = Observation(0.0, np.zeros(4), np.array([0.1, 0.0, 0.2]))\n"
        "r = Reference(np.array([0.2, 0.1, 0.0]), np.zeros(3), np.full((5, 3), 0.2))\n"
        "print(p(o, r).tolist())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == pytest.approx(policy()(*instant()).tolist(), abs=1e-7)


def test_a_step_is_quick():
    layout = Layout(SCALE)
    rng = np.random.default_rng(0)
    layers = [
        ((rng.standard_normal((n, m)) / 8).astype(np.float32), np.zeros(n, np.float32))
        for m, n in ((15, 64), (64, 64), (64, 3))
    ]
    trial = Policy(
        Network(tracking_features(layout), layers, WHEEL_MIX), Description("quick", layout)
    )
    observation, reference = instant()
    best = np.inf
    for _ in range(1000):  # short rounds, so that one falls between what else the machine does
        start = time.perf_counter()
        for _ in range(20):
            trial(observation, reference)
        best = min(best, (time.perf_counter() - start) / 20)
    print(f"{1e6 * best:.1f} us a step")
    assert best < 40e-6
