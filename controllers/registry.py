"""Controllers by name. The module of a controller is imported when one is built."""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain
from typing import Any

from controllers.interface import Controller, Loop
from controllers.policy.policy import Policy, PolicySettings
from controllers.policy.policy_file import load_policy, shipped_policies
from controllers.tuning.gains_file import is_gains_file, load_gains
from controllers.user_file import file_of, is_user_file, user_controller
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model

Settings = Mapping[str, Any]
"""Numbers and texts by name, JSON-able, that a factory takes beside model and loop."""


@dataclass(frozen=True)
class Entry:
    """One name of the registry.

    Attributes
    ----------
    build : ``(model, loop, **settings) -> Controller``, quick
    summary : one line for a user who has to choose
    design : ``(model, loop, **options) -> settings`` of ``build``, where finding them takes a
        search that is worth keeping; None where ``build`` does all
    extra : optional package that ``design`` needs, and the extra of that name brings
    """

    build: Callable[..., Controller]
    summary: str
    design: Callable[..., Settings] | None = None
    extra: str | None = None


def _kinematic(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.kinematic import Gains, KinematicControl

    return KinematicControl(model.geometry, Gains(**settings), loop.torque_limit, loop.sample_time)


def _kinematic_gains(model: Model, loop: Loop) -> Settings:
    """The best gains within the margins and the torque rate that ``tuning`` asks for."""
    from controllers.kinematic import Gains
    from controllers.tuning.trials import TuningTrial, references
    from controllers.tuning.tunable_laws import TunableKinematic
    from controllers.tuning.tuning import GainSearch, Requirements, allowed_torque_rate

    trial = TuningTrial(model, loop, references(model))
    wanted = Requirements(torque_rate=allowed_torque_rate(model, loop, trial))
    return asdict(Gains(**GainSearch(TunableKinematic(model, loop), trial).best(wanted).point))


def _unconstrained_gains(model: Model, loop: Loop) -> Settings:
    """The best gains that are stable at all."""
    from controllers.tuning.trials import TuningTrial, references
    from controllers.tuning.tunable_laws import TunableKinematic
    from controllers.tuning.tuning import GainSearch

    trial = TuningTrial(model, loop, references(model))
    return GainSearch(TunableKinematic(model, loop), trial).best(None).point


def _computed_torque(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.computed_torque.computed_torque import ComputedTorque

    return ComputedTorque(model, loop, **settings)


def _adaptive(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.computed_torque.adaptive import AdaptiveComputedTorque

    return AdaptiveComputedTorque(model, loop, **settings)


def _pid_gains(model: Model, loop: Loop, **options: Any) -> Settings:
    """The fastest poles within the margins that :func:`controllers.pid.design.design` asks for."""
    from controllers.pid.design import design

    return asdict(design(model, loop, **options))


def _pid(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.pid.design import PIDGains
    from controllers.pid.pid import PID

    return PID(model, loop, PIDGains(**settings))


def _lqi_weights(model: Model, loop: Loop, **options: Any) -> Settings:
    """The fastest weights within the margins that ``lqi.design.fastest`` asks for."""
    from controllers.lqi.design import fastest

    return asdict(fastest(model, loop, **options))


def _lqi(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.lqi.design import Weights
    from controllers.lqi.lqi import LQI

    return LQI(model, loop, Weights(**settings))


def _of_gains_file(path: str, model: Model, loop: Loop) -> Controller:
    from controllers.kinematic import Gains, KinematicControl
    from controllers.pid.pid import PID

    gains = load_gains(path)
    if isinstance(gains, Gains):
        return KinematicControl(model.geometry, gains, loop.torque_limit, loop.sample_time)
    return PID(model, loop, gains)


CONTROLLERS: dict[str, Entry] = {
    "kinematic": Entry(_kinematic, "wheel-speed PI, gains like the stock ones"),
    "kinematic_tuned": Entry(
        _kinematic, "the same, tuned for model and loop within stability margins", _kinematic_gains
    ),
    "kinematic_free": Entry(
        _kinematic, "the same, its unconstrained best: hardly any margin", _unconstrained_gains
    ),
    "pid": Entry(_pid, "PID on the body twist, gains from the model's masses", _pid_gains),
    "lqi": Entry(
        _lqi,
        "linear quadratic control with integrals, the delays in its state",
        _lqi_weights,
        extra="control",
    ),
    "computed_torque": Entry(
        _computed_torque, "the model's inverse dynamics fed forward in time, and feedback"
    ),
    "adaptive": Entry(_adaptive, "computed torque that goes on identifying while it drives"),
}
"""Every controller that a name alone stands for."""


def entry(name: str) -> Entry:
    """The entry of a name, of a shipped policy, or of a file of gains or of a policy (NAME.json).

    Raises
    ------
    InputError
        If there is none: with the names that come closest.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    if name.endswith(".json") and is_gains_file(name):
        return Entry(partial(_of_gains_file, name), "gains of `youbot tune`")
    if is_user_file(name):
        return Entry(partial(user_controller, name), "your own")
    if name in (shipped := shipped_policies()) or name.endswith(".json"):
        return Entry(partial(build_policy, name), "a trained policy")
    known = (*CONTROLLERS, *shipped)
    close = difflib.get_close_matches(name, known, 3)
    hint = f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(known)}"
    raise InputError(
        f"controller {name!r}: not known; {hint}, or a .json of `youbot tune` or of a policy, or "
        "your own: FILE.py (see CONTRIBUTING)"
    )


def check(name: str) -> None:
    """Refuse what cannot be designed, before anything is computed for it.

    Raises
    ------
    InputError
        If the name is unknown, or its design needs an extra that is not installed.
    """
    if is_user_file(name):
        # Built once on the published model: a mistake shows now, not after hours of work.
        user_controller(name, load_model("paper"), Loop())
    extra = entry(name).extra
    if extra is not None and importlib.util.find_spec(extra) is None:
        raise InputError(
            f"controller {name!r}: its design needs an extra, pip install 'youbot[{extra}]'; "
            "or name controllers without it"
        )


def fingerprint(name: str) -> str:
    """A hash of what a file of that name holds; empty for controllers of this package.

    Raises
    ------
    InputError
        If the name is unknown or the file is not valid.
    """
    entry(name)
    if name in CONTROLLERS:
        return ""
    if is_user_file(name):
        return hashlib.sha256(file_of(name).read_bytes()).hexdigest()
    if name.endswith(".json") and is_gains_file(name):
        return hashlib.sha256(repr(load_gains(name)).encode()).hexdigest()
    network, description = load_policy(name)
    # The content, not the file: the weights may be in either of two formats.
    found = hashlib.sha256(repr(description).encode())
    for array in (network.features, network.mix, *chain.from_iterable(network.layers)):
        found.update(array.tobytes())
    return found.hexdigest()


def build(name: str, model: Model, loop: Loop, **settings: Any) -> Controller:
    """The controller of a name.

    Parameters
    ----------
    model : what the controller believes of the platform
    loop : where it will run
    settings : of this controller; where none are given and it has a ``design``, that is made first

    Raises
    ------
    InputError
        If the name is unknown, or the controller cannot be built on this model.
    """
    found = entry(name)
    if found.design is not None and not settings:
        settings = dict(found.design(model, loop))
    return found.build(model, loop, **settings)


def build_policy(source: str | os.PathLike[str], model: Model, loop: Loop) -> Policy:
    """A policy file, or a shipped policy by name, ready to drive.

    Parameters
    ----------
    model : what the base controller believes; a policy that drives alone knows no model
    loop : must have the control rate that the policy was trained at

    Raises
    ------
    InputError
        If the file is no valid policy, or the loop or the robot's wheels are not those that it was
        trained for.
    """
    network, description = load_policy(source)
    difference = abs(loop.sample_time * description.control_rate - 1.0)
    if difference > PolicySettings.max_rate_difference_share:
        raise InputError(
            f"policy {description.name}: was trained at {description.control_rate:g} Hz, the loop "
            f"runs at {1.0 / loop.sample_time:g} Hz; train one for it"
        )
    if (here := model.geometry.arrangement) != description.rollers:
        raise InputError(
            f"policy {description.name}: was trained on a robot with rollers in "
            f"{description.rollers}, these stand in {here}; train one on it: "
            "youbot train ppo --model MODEL"
        )
    base = None
    if description.base is not None:
        if description.base not in CONTROLLERS:
            raise InputError(
                f"policy {description.name}: sits on {description.base!r}, which is none of "
                f"{', '.join(CONTROLLERS)}"
            )
        base = build(description.base, model, loop)
    return Policy(network, description, base, loop.torque_limit)
