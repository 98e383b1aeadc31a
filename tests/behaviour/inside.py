"""What the package does when it is called from Python: run as a script, it writes NAME.json.

It takes public names from the tops of the packages, as the documents do. The few names that the
documents take from a module stand in `ELSEWHERE`; one that has moved is looked for in all modules.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import pkgutil
import shlex
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

TOPS = ("youbot_env", "identification", "controllers")

ELSEWHERE = {
    "calibration": "youbot_env.motions",
    "record": "youbot_scripts.record",
    "load_effects": "youbot_env.plugins",
    "build_policy": "controllers.policy",
    "Loop": "controllers.interface",
    "Observation": "controllers.interface",
    "Reference": "controllers.interface",
}
"""Public names that README and docs/ import from a module, and from which."""

NOISY = {
    "wheel_speed_noise": 0.02,
    "encoder_ticks": 103_352,
    "delay": 2,
    "lag": 0.03,
    "action_history": 3,
    "randomise": {"m0": ("80%", "120%"), "aY": ("80%", "120%"), "mu1": (0.08, 0.14)},
    "effects": {"floor_tilt": {"tilt_x": 0.01, "tilt_y": -0.005}},
}
"""Options of an environment: everything that draws random numbers, and what makes it late."""

TORQUES = (1.0, 1.2, 0.8, -0.6)
"""Peaks [N m] of the torques that plants are driven with."""

CASES: dict[str, Callable[..., Any]] = {}


def case(function: Callable[..., Any]) -> Callable[..., Any]:
    CASES[function.__name__] = function
    return function


def public(name: str) -> Any:
    """A public name, from the top of a package, from where it used to be, or from anywhere."""
    for module in (*TOPS, ELSEWHERE.get(name)):
        try:
            found = getattr(importlib.import_module(module), name) if module else None
        except (ImportError, AttributeError):
            continue
        if callable(found):
            return found
    for top in (*TOPS, "youbot_scripts"):
        package = importlib.import_module(top)
        for module in pkgutil.walk_packages(package.__path__, f"{top}."):
            try:
                found = getattr(importlib.import_module(module.name), name, None)
            except ImportError:
                continue
            if callable(found) and found.__module__ == module.name:
                return found
    raise LookupError(f"no package has {name}")


def plain(value: Any) -> Any:
    """As JSON: arrays become lists, keys words."""
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def outcome(function: Callable[[], Any]) -> Any:
    """What a function returns, or how it fails."""
    try:
        return function()
    except Exception as error:  # a failure is behaviour too
        return f"{type(error).__name__}: {error}"


def torques(steps: int, every: float) -> np.ndarray:
    """Smooth torques (steps, 4) [N m], another for each wheel."""
    time = every * np.arange(steps)[:, None]
    return np.array(TORQUES) * np.sin(time * (2.0, 2.3, 2.7, 3.1) + (0.0, 0.5, 1.0, 1.5))


# --- command lines ---------------------------------------------------------------------------


@case
def lines(*given: str) -> Any:
    """Command lines one after another in one process: a start costs more than a refusal."""
    from youbot_scripts.cli import main as youbot

    found = {}
    for line in given:
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = outcome(partial(youbot, shlex.split(line)))
        found[line] = {
            "status": status,
            "stdout": out.getvalue().splitlines(),
            "stderr": err.getvalue().splitlines(),
        }
    return found


# --- environments ----------------------------------------------------------------------------


def episode(env: Any, steps: int) -> dict[str, Any]:
    """Everything that an episode of random actions shows."""
    observation, info = env.reset(seed=5)
    rng, shown = np.random.default_rng(5), []
    for k in range(steps):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(env.action_space.dtype)
        observation, reward, terminated, truncated, info = env.step(action)
        ends = terminated or truncated
        shown.append([k, *observation.ravel().tolist(), float(reward), terminated, truncated])
        if ends:
            observation, info = env.reset(seed=6)
    return {"steps": shown, "last_info": info, "spaces": [env.action_space, env.observation_space]}


def registered() -> list[str]:
    """Ids of the environments that the package registers."""
    import gymnasium as gym

    importlib.import_module("youbot_env")
    return sorted(
        name for name, spec in gym.registry.items() if str(spec.entry_point).startswith(TOPS)
    )


@case
def environments() -> Any:
    import gymnasium as gym

    kinds = {"plain": ({}, 300), "noisy": (NOISY, 300), "contact": ({"plant": "contact"}, 100)}
    return {
        name: {
            kind: outcome(
                lambda name=name, options=options, steps=steps: episode(
                    gym.make(f"youbot_env:{name}", **options), steps
                )
            )
            for kind, (options, steps) in kinds.items()
        }
        for name in registered()
    }


@case
def own_options() -> Any:
    """An environment on an uncertain model, with a reference and margins of its own."""
    import gymnasium as gym

    options = {
        "model": "model.json",
        "randomise": "covariance",
        "reference": public("multisine")(np.random.default_rng(3)),
        "control_rate": 50.0,
        "preview": 2,
        "reward_margins": {"yaw_rate": 0.05},
        "initial_state": {"twist": (0.1, 0.0, 0.2)},
    }
    return episode(gym.make("youbot_env:YouBotTracking-v0", **options), 100)


@case
def pictures() -> Any:
    import hashlib

    import gymnasium as gym

    env = gym.make("youbot_env:YouBotTracking-v0", render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(50):
        env.step(np.full(4, 0.3, np.float32))
    frame = np.asarray(env.render())
    return {"shape": frame.shape, "sha256": hashlib.sha256(frame.tobytes()).hexdigest()}


# --- models and plants -----------------------------------------------------------------------


def with_each_effect(model: Any) -> dict[str, Any]:
    """The model with each effect of the catalogue at its size, and with several."""
    catalogue = importlib.import_module("youbot_env").CATALOGUE
    found = {"none": model}
    for effect in catalogue:
        values = {
            name: parameter.size
            for parameter in effect.public_parameters
            for name in parameter.names
            if parameter.default is None and parameter.size is not None
        }
        found[effect.name] = model.with_effect(effect.name, **values)
    several = model.with_effect("floor_tilt", tilt_x=0.01, tilt_y=-0.02)
    several = several.with_effect("wheel_coulomb_friction", torque=0.2)
    found["several"] = several.with_effect("actuator_lag", time_constant=0.03)
    return found


@case
def models() -> Any:
    """The functions of a model, at a dozen random instants, with each effect."""
    rng = np.random.default_rng(2)
    twist, acceleration = rng.normal(0, 0.4, (12, 3)), rng.normal(0, 1.0, (12, 3))
    torque = rng.normal(0, 1.0, (12, 4))
    calls: dict[str, Callable[[Any], Any]] = {
        "wrench": lambda m: m.wrench(twist, acceleration),
        "inverse_dynamics": lambda m: m.inverse_dynamics(twist, acceleration),
        "forward_dynamics": lambda m: m.forward_dynamics(twist, torque),
        "linearise": lambda m: m.linearise(twist[0], torque[0]),
        "mass_matrix": lambda m: m.mass_matrix,
        "theta": lambda m: m.theta,
        "values": lambda m: m.values,
        "state_names": lambda m: m.structure.state_names,
    }
    models = with_each_effect(public("load_model")("paper"))
    return {
        name: {call: outcome(lambda f=f, m=m: f(m)) for call, f in calls.items()}
        for name, m in models.items()
    }


@case
def plants() -> Any:
    """Half a second of each plant, and of several platforms side by side."""
    load, plant = public("load_model"), public("Plant")
    given = torques(50, 0.01)

    def drive(model: Any) -> Any:
        moved = plant(model)
        moved.reset(twist=(0.1, -0.05, 0.2))
        return [plain(moved.step(torque, 0.01)) for torque in given][::5]

    found = {
        name: outcome(lambda m=m: drive(m)) for name, m in with_each_effect(load("paper")).items()
    }
    many = plant(load("paper"), platforms=8)
    for torque in given:
        many.step(np.outer(np.linspace(-1, 1, 8), torque), 0.02)
    return {**found, "eight": many.state}


@case
def contact_plant() -> Any:
    load, plant, contact = public("load_model"), public("ContactPlant"), public("Contact")
    model = load("paper").with_effect("floor_tilt", tilt_x=0.02, tilt_y=0.01)
    moved = plant(model, contact(friction=0.4, rollers=12))
    states = [plain(moved.step(torque, 0.01)) for torque in torques(100, 0.01)]
    return {"states": states[::5], "wheel_rates": moved.wheel_rates, "height": moved.height}


@case
def motions() -> Any:
    time = np.linspace(0, 130, 66)
    found = {
        "calibration": public("calibration")(),
        "multisine": public("multisine")(np.random.default_rng(1)),
    }
    return {
        name: {"twist": m.twist(time), "acceleration": m.acceleration(time), "dict": m.to_dict()}
        for name, m in found.items()
    }


@case
def model_files() -> Any:
    load, save = public("load_model"), public("save_model")
    model = load("paper").with_effect("tether", stiffness=20.0, anchor_x=2.0, anchor_y=0.0)
    save("saved.json", model)
    again = load("saved.json")
    return {"values": again.values, "text": Path("saved.json").read_text()}


# --- the model in other tools ----------------------------------------------------------------


@case
def step_functions() -> Any:
    load, start = public("load_model"), public("initial_state")
    models, found = with_each_effect(load("paper")), {}
    for name in ("none", "floor_tilt", "several"):
        move = public("step_function")(models[name], 0.01)
        state = start(move.model, twist=(0.1, 0.0, 0.1))
        states = [state := move(state, torque) for torque in torques(40, 0.01)]
        found[name] = states[::4]
    return found


@case
def control_systems() -> Any:
    import control

    respond: Any = control.input_output_response
    system = public("to_control")("paper", outputs=["velocity_x", "yaw_rate", "velocity_fl"])
    time = np.linspace(0, 2, 101)
    torque = np.outer([1.0, 1.2, 1.0, 1.2], np.sin(2 * time))
    heavy = respond(system, time, torque, params={"m0": 50.0})
    about = public("linear_control")("paper", (0.5, 0.0, 0.3), twist_only=True)
    return {
        "inputs": system.input_labels,
        "states": system.state_labels,
        "run": respond(system, time, torque).outputs[:, ::10],
        "heavy": heavy.outputs[:, ::10],
        "A": about.A,
        "B": about.B,
        "C": about.C,
        "D": about.D,
    }


@case
def torch_modules() -> Any:
    import torch

    torch.set_num_threads(1)
    load, start = public("load_model"), public("initial_state")
    model = load("paper").with_effect("wheel_coulomb_friction", torque=0.2)
    platform = public("to_torch")(model)
    state = torch.tensor(np.tile(start(model, twist=(0.1, 0.0, 0.2)), (2, 1)))
    run = platform.rollout(state, torch.tensor(np.tile(torques(30, 0.01), (2, 1, 1))), 0.01)
    (run[..., :3] ** 2).sum().backward()
    gradients = {
        name: None if p.grad is None else p.grad.tolist() for name, p in platform.named_parameters()
    }
    return {"run": run.detach().numpy()[0, ::3], "gradients": gradients}


@case
def bodies() -> Any:
    mujoco: Any = importlib.import_module("mujoco")
    text = public("to_mjcf")("paper")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0, 1.2, 1.0, 1.2
    mujoco.mj_step(model, data, 500)
    return {
        "text": text,
        "mass": model.body_mass,
        "inertia": model.body_inertia,
        "damping": model.dof_damping,
        "friction": model.geom_friction[:8],
        "speed": data.qvel[:10],
    }


# --- identification and control --------------------------------------------------------------


OWN_EFFECT = """
from youbot_env import BODY, Parameter, effect


@effect(
    acts_at=BODY,
    parameters=[
        Parameter("force", "N", lower=0.0, size=4.0),
        Parameter("smoothing", "m/s", default=0.01, lower=1e-4),
    ],
    source="Dry friction of a trailing cable",
    recognise="A force of constant size against the velocity, whichever way the robot drives.",
    dissipative=True,
)
def trailing_hose(xp, body, force, smoothing):
    vx, vy, _ = body.twist
    pull = force / xp.sqrt(vx**2 + vy**2 + smoothing**2)
    return pull * vx, pull * vy, 0.0
"""


@case
def identification_calls() -> Any:
    """README's effect of one's own, from the plant to the comparison on a held-out run."""
    Path("cable.py").write_text(OWN_EFFECT)
    public("load_effects")("cable.py")
    identify, compare = public("identify"), public("compare")
    robot = public("load_model")("paper").with_effect("trailing_hose", force=4.0)
    fitted, held_out = public("record")(
        robot, [public("calibration")(), public("multisine")(np.random.default_rng(1))]
    )
    base = identify([fitted])
    better = identify([fitted], start=base.model.with_effect("trailing_hose"))
    return {
        "base": base.to_dict(),
        "better": better.to_dict(),
        "compare": compare(better.model, [held_out]).to_dict(),
    }


@case
def logs() -> Any:
    """A log as it is read, and written again."""
    found = {}
    for path in sorted(Path().glob("shipped/*.csv.gz")):
        log = public("read_log")(path)
        shown = {key: getattr(log, key) for key in ("name", "joints", "rate", "duration")}
        shown |= {
            key: np.asarray(getattr(log, key))[::200] for key in ("time", "velocity", "effort")
        }
        found[path.name] = {**shown, "rows": len(log), "warnings": log.warnings}
        public("write_log")(f"again_{path.name.removesuffix('.gz')}", log)
    return found


@case
def observability() -> Any:
    seen = public("motion_observability")
    motion = public("multisine")(np.random.default_rng(1))
    result = outcome(lambda: seen(motion))
    if isinstance(result, str):
        return result
    shown = {key: getattr(result, key) for key in ("names", "gramian", "rank", "blind", "blocks")}
    return {**shown, "in_words": result.describe_blind()}


@case
def recursive() -> Any:
    rng = np.random.default_rng(4)
    estimator = public("RecursiveLeastSquares")(3)
    truth = np.array([1.0, -2.0, 0.5])
    found = []
    for _ in range(40):
        columns = rng.normal(size=(2, 3))
        found.append(estimator.update(columns, columns @ truth + 0.1 * rng.normal(size=2)).copy())
    return {"estimates": found, "covariance": estimator.covariance}


@case
def policies() -> Any:
    """What the shipped policies do, called as a controller is."""
    model, loop = public("load_model")("paper"), public("Loop")(sample_time=0.01)
    observed, wanted = public("Observation"), public("Reference")
    motion = public("multisine")(np.random.default_rng(7))
    found = {}
    for name in ("ppo", "residual_ppo"):
        policy = public("build_policy")(name, model, loop)
        policy.reset()
        rng, rows = np.random.default_rng(8), []
        for k in range(60):
            ahead = 0.01 * (k + 1 + np.arange(policy.preview_needed))
            twist = motion.twist(0.01 * k) + rng.normal(0, 0.02, 3)
            seen = observed(0.01 * k, model.geometry.wheel_speeds(twist), twist)
            reference = wanted(
                motion.twist(0.01 * k),
                motion.acceleration(0.01 * k),
                motion.twist(ahead),
                motion.acceleration(ahead),
            )
            rows.append(plain(policy(seen, reference)))
        found[name] = rows
    return found


def main(arguments: list[str]) -> int:
    """Run the case of this name, with the other words as arguments; write what it returns."""
    name, *given = arguments
    Path(f"{name}.json").write_text(json.dumps(plain(CASES[name](*given)), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
