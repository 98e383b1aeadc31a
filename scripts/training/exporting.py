"""From a Stable-Baselines3 model to a policy that runs with numpy alone."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from torch import nn

from controllers.interface import Array
from controllers.policy.inputs import Layout, plain_features
from controllers.policy.policy import ACTIVATIONS, Description, Network
from controllers.policy.policy_file import save_policy
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.tracking.task import twist_scale
from youbot_scripts.training.conditions import Conditions
from youbot_scripts.training.settings import chosen

ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC, "td3": TD3}

_ACTIVATION_NAMES = {nn.Tanh: "tanh", nn.ReLU: "relu"}


def network_of(model: Any, features: Array, mix: Array) -> Network:
    """The network of ``model.predict(deterministic=True)``, without torch.

    Parameters
    ----------
    model : PPO, SAC or TD3 with a plain "MlpPolicy"
    features : (F, D) between observation and network
    mix : (4, A) between network and wheels

    Raises
    ------
    InputError
        If the policy has parts that a plain network has not (images, gSDE, normalised actions).
    """
    policy = model.policy
    if isinstance(model, PPO):
        modules = [*policy.mlp_extractor.policy_net, policy.action_net]
    elif isinstance(model, SAC):
        modules = [*policy.actor.latent_pi, policy.actor.mu]
    else:
        modules = [*policy.actor.mu]
    # SAC and TD3 end with tanh, which `Network` applies itself; PPO's actions are clipped.
    squashed = not isinstance(model, PPO)
    modules = [
        m
        for k, m in enumerate(modules)
        if not (squashed and isinstance(m, nn.Tanh) and k == len(modules) - 1)
    ]
    linear = [module for module in modules if isinstance(module, nn.Linear)]
    between = [type(module) for module in modules if not isinstance(module, nn.Linear)]
    plain = (
        len(between) == len(linear) - 1
        and len(set(between)) <= 1
        and set(between) <= set(_ACTIVATION_NAMES)
        and not getattr(model, "use_sde", False)
        and linear[0].in_features == len(features)
        and linear[-1].out_features == mix.shape[1]
    )
    if not plain:
        raise InputError(
            "policy: only plain networks of linear layers between tanh or relu can be exported, "
            f"with {len(features)} inputs and {mix.shape[1]} outputs"
        )
    layers = [(_numbers(layer.weight), _numbers(layer.bias)) for layer in linear]
    name = _ACTIVATION_NAMES[between[0]] if between else next(iter(ACTIVATIONS))
    return Network(features, layers, mix, name, squashed)


def _numbers(tensor: torch.Tensor) -> np.ndarray:
    # float32, in which torch has trained it.
    return tensor.detach().cpu().numpy().astype(np.float32)


def export_policy(
    model: Any,
    path: str | os.PathLike[str],
    description: Description,
    features: Array | None = None,
    mix: Array | None = None,
) -> Network:
    """Write a Stable-Baselines3 model as a policy file and return its network.

    Parameters
    ----------
    model : PPO, SAC or TD3 with a plain "MlpPolicy"
    path : of the description, NAME.json; the weights go to NAME.safetensors beside it
    features, mix : see ``network_of``; None where the model was trained on the environment as it is

    Raises
    ------
    InputError
        If the model cannot be exported or the file not written.
    """
    features = plain_features(description.layout) if features is None else features
    network = network_of(model, features, np.eye(4) if mix is None else mix)
    save_policy(path, network, description)
    return network


def import_zip(algorithm: str, path: str | os.PathLike[str]) -> Any:
    """Load a Stable-Baselines3 zip. It holds pickles: **loading one can run any code.**

    Raises
    ------
    InputError
        If the file is no such zip.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # from spaces that other versions have pickled
            return ALGORITHMS[algorithm].load(path, device="cpu")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # unpickling can raise any exception
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: no {algorithm.upper()} model could be loaded: {reason}"
        ) from None


def write_imported(
    found: Any, name: str, folder: Path, conditions: Conditions, model: Model
) -> Path:
    """Write a model that was trained elsewhere as a policy file into a folder; returns its path.

    Parameters
    ----------
    found : PPO, SAC or TD3, see ``export_policy``
    name : of the file that it was read from
    conditions, model : that it was trained under and for

    Raises
    ------
    InputError
        If the policy cannot be exported or written.
    """
    scale = tuple(twist_scale(model.geometry).tolist())
    inputs = int(found.observation_space.shape[0])
    description = Description(
        name=Path(name).stem,
        layout=layout_of(inputs, scale, conditions.action_history),  # pyright: ignore[reportArgumentType]
        torque_limit=conditions.torque_limit,
        control_rate=conditions.control_rate,
        rollers=model.geometry.arrangement,
        training={"imported_from": name, "steps": int(found.num_timesteps)},
    )
    folder.mkdir(parents=True, exist_ok=True)
    policy = folder / "policy.json"
    export_policy(found, policy, description)
    return policy


def layout_of(observations: int, twist_scale: tuple[float, float, float], history: int) -> Layout:
    """The environment's layout of observations with this many numbers.

    Raises
    ------
    InputError
        If there is none with ``history`` past actions.
    """
    # 3 numbers of a twist for each previewed sample, 4 wheels for each past action.
    preview, rest = divmod(observations - 6 - 4 * history, 3)
    if rest or preview < 0:
        raise InputError(
            f"policy: {observations} inputs are not 6 + 3 preview + 4 action_history with "
            f"action_history {history}; give the one that it was trained with"
        )
    return Layout(twist_scale, preview, history)


def import_policy(algorithm: str, path: Path, folder: Path, given: dict[str, Any]) -> Path:
    """Turn a Stable-Baselines3 zip into a policy file as the command does, and return its path.

    Parameters
    ----------
    path, folder : the zip, and where the policy goes
    given : options by the command's names, those that were given: what it was trained under

    Raises
    ------
    InputError
        If an option cannot be, the file is no such zip, or its policy cannot be written.
    """
    choice, model = chosen(algorithm, {**given, "seed": 0})
    if choice.base is not None:
        raise InputError("import: a policy on top of a controller cannot be imported, only trained")
    print(
        f"youbot: warning: {path} holds pickles: loading it runs whatever code its author put "
        "there",
        file=sys.stderr,
    )
    found = import_zip(algorithm, path)
    return write_imported(found, path.name, folder, choice.conditions, model)
