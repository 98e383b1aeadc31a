"""A run of training: learner, evaluations and checkpoints, new or resumed."""

from __future__ import annotations

import platform
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise

from controllers.policy.policy import Network
from controllers.policy.policy_file import load_policy, save_policy
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_scripts.shared import options as common
from youbot_scripts.training.exporting import ALGORITHMS, network_of
from youbot_scripts.training.platforms import FeatureVecEnv
from youbot_scripts.training.run_folder import RunFolder
from youbot_scripts.training.settings import (
    ACTION_NOISE,
    EVALUATION_SEED,
    TEST_SEED,
    Choice,
    chosen,
)
from youbot_scripts.training.trainee import ACTIVATIONS, Trainee, prepare

Report = Callable[[dict[str, Any]], None]
"""Called with each evaluation: steps, wall_time and cpu_time [s], error, error_by_axis."""


def train(
    choice: Choice,
    model: Model,
    folder: RunFolder,
    *,
    device: str = "cpu",
    tensorboard: bool = False,
    progress: Callable[..., None] = lambda steps=1: None,
    report: Report = lambda row: None,
) -> tuple[Trainee, dict[str, Any]]:
    """Train to the choice's total of steps, from the folder's checkpoint if it has one.

    The folder always holds the best policy by held-out error. On one machine, one seed gives
    exactly the same weights; a resumed run continues with other random numbers.

    Returns
    -------
    what was trained, and its record: learning curve, steps, times

    Raises
    ------
    InputError
        If an option is out of its range.
    """
    # One thread is faster for small networks, and keeps the order of sums, so results repeat.
    torch.set_num_threads(1)
    trainee = prepare(choice, model)
    state, replay = folder.load()
    begun = 0 if state is None else int(state["steps"])
    learner = _learner(trainee, begun, device, folder if tensorboard else None)
    if state is not None:
        _restore(learner, state, replay, folder)
    keeper = _Keeper(trainee, folder, state, progress, report)
    if begun < choice.learner.steps:
        with _diverging(folder):
            learner.learn(choice.learner.steps - begun, keeper, reset_num_timesteps=state is None)
        keeper.evaluate()
    return trainee, keeper.record()


@contextmanager
def _diverging(folder: RunFolder) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except ValueError as error:  # torch's distributions raise it for NaN
        if "invalid values" not in str(error):
            raise
        raise InputError(
            f"train: the network's weights became NaN; lower learning_rate (the last good policy "
            f"is in {folder.path})"
        ) from None


def finish(trainee: Trainee, folder: RunFolder, record: dict[str, Any]) -> Network:
    """Put the record into the best policy's description, and return its network."""
    network, description = load_policy(folder.policy)
    save_policy(folder.policy, network, replace(description, training=record))
    return network


def _learner(trainee: Trainee, begun: int, device: str, board: RunFolder | None) -> Any:
    choice, learner = trainee.choice, trainee.choice.learner
    # The state of random generators is not saved. The same seed would repeat the first references.
    seed = choice.seed if begun == 0 else choice.seed + begun
    env = FeatureVecEnv(
        trainee.fleet(learner.envs), trainee.features, trainee.mix, (choice.seed, begun)
    )
    options = dict(learner.learning)
    if "n_steps" in options:
        # Of few copies a round is smaller than a batch: it is one then.
        options["batch_size"] = min(options["batch_size"], options["n_steps"] * learner.envs)
    first, last = options.pop("learning_rate"), learner.final_learning_rate
    if choice.algorithm == "td3":
        size = trainee.mix.shape[1]
        options["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, ACTION_NOISE))
    policy = {**learner.policy, "activation_fn": ACTIVATIONS[learner.activation]}
    try:
        found = ALGORITHMS[choice.algorithm](
            "MlpPolicy",
            env,
            # Stable-Baselines3 passes the share of the run that is left, from 1 to 0.
            learning_rate=lambda left: last + (first - last) * left,
            policy_kwargs=policy,
            tensorboard_log=None if board is None else str(board.path / "tensorboard"),
            # NumPy's global seed, which Stable-Baselines3 sets, has 32 bits.
            seed=seed % 2**32,
            device=device,
            **options,
        )
    except (ValueError, TypeError, AssertionError, RuntimeError, ImportError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"train {choice.algorithm}: {reason}") from None
    return found


def _restore(
    learner: Any, state: dict[str, Any], replay: dict[str, Any] | None, folder: RunFolder
) -> None:
    try:
        learner.set_parameters(state["parameters"])
        # TD3's delayed policy updates count from _n_updates.
        learner.num_timesteps, learner._n_updates = int(state["steps"]), int(state["updates"])
        if replay is not None:
            buffer = learner.replay_buffer
            count = int(replay["count"])
            for name in _REPLAY:
                getattr(buffer, name)[:count] = replay[name].numpy()
            buffer.pos, buffer.full = int(replay["pos"]), bool(replay["full"])
    except (KeyError, ValueError, RuntimeError, AttributeError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{folder.checkpoint}: does not fit its run.json: {reason}") from None


_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def _replay(learner: Any) -> dict[str, Any] | None:
    """Replay buffer of an off-policy learner as tensors; None for PPO.

    Only the filled part, copied, since training goes on in the same buffer.
    """
    buffer = getattr(learner, "replay_buffer", None)
    if buffer is None:
        return None
    count = buffer.buffer_size if buffer.full else buffer.pos
    held = {name: torch.from_numpy(getattr(buffer, name)[:count].copy()) for name in _REPLAY}
    return {**held, "count": count, "pos": buffer.pos, "full": buffer.full}


class _Keeper(BaseCallback):
    """Callback: evaluates at equal intervals, saves best policy and checkpoints, moves the bar."""

    def __init__(
        self,
        trainee: Trainee,
        folder: RunFolder,
        state: dict[str, Any] | None,
        progress: Callable[..., None],
        report: Report,
    ) -> None:
        super().__init__()
        self._trainee, self._folder = trainee, folder
        self._progress, self._report = progress, report
        state = state or {"steps": 0, "curve": [], "wall_time": 0.0, "cpu_time": 0.0}
        self._curve: list[dict[str, Any]] = list(state["curve"])
        # Times of a resumed run include those before the interruption.
        self._wall = time.perf_counter() - state["wall_time"]
        self._cpu = time.process_time() - state["cpu_time"]
        self._steps = int(state["steps"])
        progress(self._steps)

    @property
    def _interval(self) -> float:
        return self._trainee.choice.learner.steps / self._trainee.choice.learner.evaluations

    def record(self) -> dict[str, Any]:
        """Learning curve, steps and times so far."""
        return {"steps": self._steps, **self._times(), "curve": self._curve}

    def _times(self) -> dict[str, float]:
        return {
            "wall_time": time.perf_counter() - self._wall,
            "cpu_time": time.process_time() - self._cpu,
        }

    def _on_step(self) -> bool:
        self._progress(self.training_env.num_envs)
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._steps >= self._interval:
            self.evaluate()

    def evaluate(self) -> None:
        """Evaluate the present policy, and save results, best policy and checkpoint."""
        if self.num_timesteps == self._steps:
            return
        trainee = self._trainee
        network = network_of(self.model, trainee.features, trainee.mix)
        found = trainee.judge(network, EVALUATION_SEED).to_dict()
        best = min((row["error"] for row in self._curve), default=np.inf)
        self._steps = self.num_timesteps
        row = {"steps": self._steps, **self._times(), **found}
        self._curve.append(row)
        if found["error"] < best or not self._folder.policy.exists():
            save_policy(self._folder.policy, network, trainee.description)
        self._save()
        self.logger.record("held_out/error", found["error"])
        for axis, error in found["error_by_axis"].items():
            self.logger.record(f"held_out/{axis}", error)
        self._report(row)

    def _save(self) -> None:
        state = {
            "parameters": self.model.get_parameters(),
            "updates": getattr(self.model, "_n_updates", 0),
            **self.record(),
        }
        self._folder.save(state, _replay(self.model))


def train_policy(
    algorithm: str,
    path: Path,
    given: dict[str, Any],
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    report: Callable[[dict[str, Any]], None] = lambda row: None,
) -> dict[str, Any]:
    """Train as the command does and return its result: the policy's path and its record.

    Parameters
    ----------
    path : folder of the run
    given : options by the command's names, those that were given
    resume : continue the run in the folder
    tensorboard, device : as the command's
    report : called with each evaluation, see ``Report``

    Raises
    ------
    InputError
        If an option cannot be, or the folder holds another run.
    """
    folder = RunFolder(path)
    if resume:
        choice, model, command = _resumed(folder, algorithm, given)
    else:
        choice, model = chosen(algorithm, given)
        command = shlex.join(["youbot", "train", algorithm, *_words(given)])
        prepare(choice, model)  # refuses wrong options before a folder is made
        folder.begin(choice, model, command)
    with common.progress(choice.learner.steps, f"training {algorithm}") as advance:
        trainee, record = train(
            choice,
            model,
            folder,
            device=device,
            tensorboard=tensorboard,
            progress=advance,
            report=report,
        )
    record = {
        "command": command,
        "seed": choice.seed,
        "choice": choice.to_dict(),
        "model": model.name,
        **_versions(),
        **record,
    }
    network = finish(trainee, folder, record)
    tests = {"kinematic": trainee.judge_other("kinematic", model, TEST_SEED)}
    if choice.base not in (None, "kinematic"):
        tests[choice.base] = trainee.judge_other(choice.base, model, TEST_SEED)
    tests[trainee.description.name] = trainee.judge(network, TEST_SEED)
    record["test"] = {name: found.to_dict() for name, found in tests.items()}
    finish(trainee, folder, record)
    return {"policy": str(folder.policy), "training": record}


def _resumed(folder: RunFolder, algorithm: str, given: dict[str, Any]) -> tuple[Choice, Model, str]:
    choice, model, command = folder.asked()
    if given:
        raise InputError(
            f"resume: the run keeps its own settings; leave out --{next(iter(given))}, or begin "
            "another run"
        )
    if choice.algorithm != algorithm:
        raise InputError(f"{folder.path}: was begun as `{command}`; resume {choice.algorithm}")
    return choice, model, command


def _words(given: dict[str, Any]) -> list[str]:
    words = []
    for name, value in given.items():
        for item in value if isinstance(value, list) else [value]:
            words += [f"--{name}", str(item)]
    return words


def _versions() -> dict[str, Any]:
    from importlib.metadata import version

    names = ("youbot", "numpy", "torch", "stable-baselines3")
    found = {name: version(name).partition("+")[0] for name in names}
    return {"versions": {"python": platform.python_version(), **found}}
