"""Settings of the learners: one table per algorithm, and changes to it from the command line."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_scripts.training.conditions import CONDITION_NAMES, Conditions

MOST_STEPS = 10**10
"""Most control periods of a training: a year of one core."""

MOST_ENVS = 4096
"""Most platforms side by side: each has its references in memory."""


@dataclass(frozen=True)
class Learner:
    """An algorithm of Stable-Baselines3 and how it is set.

    Attributes
    ----------
    steps : control periods in all, over all platforms
    envs : platforms in parallel
    evaluations : over the run, on held-out references
    learning : arguments of the algorithm by Stable-Baselines3's names; the learning rate falls
        linearly to ``final_learning_rate``
    policy : entries of its ``policy_kwargs``
    activation : of the network, see ``controllers.policy.policy.ACTIVATIONS``
    features : "tracking" or "plain", see ``controllers.policy.inputs``
    mixed : whether the network's outputs are forward, left and turn, or four wheels
    conditions : values of ``Conditions`` that replace the defaults
    """

    steps: int
    envs: int
    learning: Mapping[str, Any]
    policy: Mapping[str, Any]
    final_learning_rate: float = 0.0
    evaluations: int = 20
    activation: str = "tanh"
    features: str = "tracking"
    mixed: bool = True
    conditions: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able; ``Learner(**this)`` is the same again."""
        return asdict(self)


OFF_POLICY: dict[str, Any] = {
    "learning_rate": 1e-3,
    "buffer_size": 200_000,
    "learning_starts": 640,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 8,
    "gamma": 0.9,
    "tau": 0.01,
}

CALM: dict[str, Any] = {
    "reward_weights": {"effort": 0.0, "smoothness": 0.3},
    "reward_margins": {"velocity_x": 0.05, "velocity_y": 0.05, "yaw_rate": 0.15, "smoothness": 1.0},
}
"""For SAC and TD3: wider margins and a penalty on changes. Without them their torques jump between
the limits, since the critics value only their mean. The penalty halves these jumps."""

LEARNERS: dict[str, Learner] = {
    "ppo": Learner(
        steps=1_250_000,
        envs=64,
        learning={
            "learning_rate": 1e-3,
            "n_steps": 64,
            "batch_size": 1024,
            "n_epochs": 10,
            "gamma": 0.9,
            "gae_lambda": 0.9,
            "clip_range": 0.2,
            "ent_coef": 0.0,
            "target_kl": 0.02,
        },
        policy={"net_arch": [64, 64], "log_std_init": -2.0},
    ),
    "sac": Learner(
        steps=40_000,
        envs=16,
        learning={**OFF_POLICY, "ent_coef": "auto_0.3", "target_entropy": -4.0},
        policy={"net_arch": [64, 64], "log_std_init": -2.0},
        activation="relu",
        conditions=CALM,
    ),
    "td3": Learner(
        steps=40_000,
        envs=16,
        learning={**OFF_POLICY, "policy_delay": 2, "target_policy_noise": 0.02},
        policy={"net_arch": [64, 64]},
        activation="relu",
        conditions=CALM,
    ),
}
"""gamma 0.9 is a horizon of ten samples, which is enough: a torque acts on the twist within two.
log_std_init gives small first actions, since a tenth of the torque already moves the platform.
target_kl keeps PPO from losing what it has learnt in the second half of a run: its actions then
vary so little that any change of their mean is a large change of the policy."""

EVALUATION_SEED, TEST_SEED = 1_000_000, 2_000_000
"""First seeds of the references that select the best policy, and of those of the final test.
Training uses spawned seed sequences, which differ from both."""

ACTION_NOISE = 0.1
"""Standard deviation of TD3's exploration noise, as a share of the torque limit."""


@dataclass(frozen=True)
class Choice:
    """Everything that a run's result depends on, except its model; stored as JSON in a run folder.

    Attributes
    ----------
    algorithm : a key of ``LEARNERS``
    learner, conditions : see there
    randomise : see ``conditions.ranges_from``
    effects : texts NAME:p=value of what the plant has beyond the model
    base, share : name of the base controller, and the policy's share of the torque limit
    seed : of everything
    """

    algorithm: str
    learner: Learner
    conditions: Conditions = field(default_factory=Conditions)
    randomise: str = "auto"
    effects: tuple[str, ...] = ()
    base: str | None = None
    share: float = 1.0
    seed: int = 0

    def to_dict(self) -> dict[str, Any]:
        """JSON-able; ``choice_from_dict`` reads it."""
        return asdict(self)


def choice_from_dict(data: Mapping[str, Any]) -> Choice:
    """Inverse of ``Choice.to_dict``.

    Raises
    ------
    InputError
        If fields are missing or unknown.
    """
    try:
        learner, conditions = Learner(**data["learner"]), Conditions(**data["conditions"])
        effects = tuple(data["effects"])
        return Choice(**{**data, "learner": learner, "conditions": conditions, "effects": effects})
    except (TypeError, KeyError) as error:
        raise InputError(f"not the settings of a run: {error}") from None


def changed(choice: Choice, assignments: Iterable[str]) -> Choice:
    """The choice with ``key=value`` texts applied; a value is JSON, or text where it is none.

    A key is a field of ``Learner``, an argument of the algorithm or of its policy, or a field of
    ``Conditions``; dots lead into dictionaries (``reward_margins.yaw_rate=0.05``).

    Raises
    ------
    InputError
        If a key is unknown, or a value has another kind than the one that it replaces.
    """
    for text in assignments:
        key, equals, word = text.partition("=")
        if not equals:
            raise InputError(f"set: {text!r} is not key=value; write for instance gamma=0.95")
        choice = _with(choice, key.strip(), _value(word.strip()))
    return choice


_TABLES = ("learning", "policy", "conditions")
"""Fields of ``Learner`` whose keys are set one by one, not as a whole."""


def _with(choice: Choice, key: str, value: Any) -> Choice:
    learner, conditions = choice.learner, choice.conditions
    head, _, rest = key.partition(".")
    if head in CONDITION_NAMES:
        old = getattr(conditions, head)
        new = {**old, rest: value} if rest and isinstance(old, Mapping) else value
        checked = _alike(key, old, new)
        return replace(choice, conditions=replace(conditions, **{head: checked}))
    for part in ("learning", "policy"):
        table = getattr(learner, part)
        if key in table:
            table = {**table, key: _alike(key, table[key], value)}
            return replace(choice, learner=replace(learner, **{part: table}))
    plain = [name for name in asdict(learner) if name not in _TABLES]
    if key in plain:
        checked = _alike(key, getattr(learner, key), value)
        return replace(choice, learner=replace(learner, **{key: checked}))
    known = [*plain, *learner.learning, *learner.policy, *CONDITION_NAMES]
    close = difflib.get_close_matches(key, known, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}"
    raise InputError(f"set: unknown key {key!r}; {hint}")


def _value(word: str) -> Any:
    try:
        return json.loads(word)
    except ValueError:
        return word


def _alike(key: str, old: Any, new: Any) -> Any:
    """The new value, if its type fits the old one's; None and text may be replaced by anything."""
    number = (int, float)
    fits = (
        old is None
        or isinstance(old, str)
        or (isinstance(old, bool) and isinstance(new, bool))
        # bool is a subclass of int, but true is no number of steps.
        or (isinstance(old, int) and isinstance(new, int) and not isinstance(new, bool))
        or (isinstance(old, float) and (new is None or isinstance(new, number)))
        or (isinstance(old, (list, tuple)) and isinstance(new, (list, tuple)))
        or (isinstance(old, Mapping) and isinstance(new, Mapping))
    )
    if not fits:
        raise InputError(f"set: {key}={new!r} cannot replace {old!r}")
    return new


SHARE = 0.3
"""Share of the torque limit for a policy that is added to a controller."""


def chosen(algorithm: str, given: dict[str, Any]) -> tuple[Choice, Model]:
    """Settings and model that the options of the command line ask for.

    Raises
    ------
    InputError
        If one cannot be.
    """
    if "share" in given and "residual" not in given:
        raise InputError("share: belongs to --residual; a policy alone may use all the torque")
    learner, model = LEARNERS[algorithm], load_model(given.get("model", "paper"))
    choice = Choice(
        algorithm,
        learner,
        Conditions(**{"torque_limit": model.geometry.max_wheel_torque, **learner.conditions}),
        randomise=given.get("randomise", "auto"),
        effects=tuple(given.get("effect", ())),
        base=given.get("residual"),
        share=given.get("share", SHARE) if "residual" in given else 1.0,
        seed=given.get("seed", 0),
    )
    short = ("steps", "envs", "delay", "lag")
    assignments = [f"{name}={given[name]}" for name in short if name in given]
    return changed(choice, [*given.get("set", ()), *assignments]), model
