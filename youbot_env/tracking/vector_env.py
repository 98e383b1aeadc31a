"""YouBotTracking-v0 as a vector environment: one compiled control period for all copies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.motions.base import Motion
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.actuation import action_rows, whole_number
from youbot_env.tracking.batch import INFO, SATURATED, TERM_NAMES, TERMS, Batch, keys_of
from youbot_env.tracking.options import check_motion, refuse_unknown, tracking_setup

Observations = NDArray[np.float32]
Step = tuple[
    Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]
]

MODES = {
    AutoresetMode.DISABLED: lanes.NEVER,
    AutoresetMode.NEXT_STEP: lanes.NEXT_STEP,
    AutoresetMode.SAME_STEP: lanes.SAME_STEP,
}

INFO_NAMES = (*INFO, "saturated", "reward_terms", "time")
"""What ``info`` can hold: arrays with a leading axis of copies, named as those of one copy."""

RESET_OPTIONS = ("initial_state", "reference", "reset_mask")


class YouBotTrackingVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """
    ``num_envs`` copies of `YouBotTracking-v0` in one compiled control period::

        envs = gym.make_vec(
            "youbot_env:YouBotTracking-v0",
            num_envs=4096,
            vectorization_mode="vector_entry_point",
            randomise={"m0": ("80%", "120%")},
        )

    Copy i of a vector that was reset with seed s is the single environment that was reset with seed
    s + i, to the bit: whatever the number of copies and of threads is, and over as many episodes as
    follow. Options, spaces, reward and `info` (but for `held`) are those of the single environment,
    beside

    | Argument         | Default     | Meaning                                                   |
    |------------------|-------------|-----------------------------------------------------------|
    | `num_envs`       | 1           | copies                                                    |
    | `autoreset_mode` | "NextStep"  | also "SameStep", "Disabled", or gymnasium's AutoresetMode |
    | `info`           | ()          | names that a step's `info` holds as arrays, or "all"      |
    | `threads`        | None        | most threads; None: `YOUBOT_THREADS`, or a thread a core  |

    A new episode has a new reference and, with `randomise`, a new model; both are drawn in compiled
    code. With "SameStep" `info` holds `final_obs` and, with `info`, `final_info`, each beside its
    mask. `reset(options={"reset_mask": mask})` begins new episodes of some copies. A copy whose
    episode is over must be reset before the next step where the mode is "Disabled".

    What a step returns is the caller's: it does not change later. Arrays that the caller has let go
    of are used again.
    """

    metadata: dict[str, Any] = {
        "render_modes": [],
        "render_fps": 100,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        info: str | Sequence[str] = (),
        threads: int | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.num_envs = whole_number("num_envs", num_envs, least=1)
        mode = _mode(autoreset_mode)
        self._names = _names(info)
        if render_mode is not None:
            raise InputError("render_mode: many copies are not drawn; make a single environment")
        if threads is not None:
            whole_number("threads", threads, least=1)
        refuse_unknown(options)
        setup = tracking_setup(**options)
        if setup.contact is not None:
            raise InputError(
                "plant: copies with real contacts are moved by MuJoCo one by one; "
                'vectorization_mode="sync" or "async" makes a vector of them'
            )
        self._rows = Batch(
            setup,
            self.num_envs,
            autoreset=MODES[mode],
            reports=bool(self._names),
            threads=threads,
        )
        rate = max(1, round(1.0 / setup.period))
        self.metadata = {**type(self).metadata, "autoreset_mode": mode, "render_fps": rate}
        self._mode = mode
        self._begun = False
        limit = setup.task.twist_limit
        self.single_action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.single_observation_space = spaces.Box(
            -limit, limit, (setup.task.observation_size,), np.float32
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes of all copies, or of those in ``options["reset_mask"]`` (n,) bool.

        Seed s gives copy i the seed s + i; a list gives each its own, and None continues with the
        next episode of its last seed. ``options`` may also hold "initial_state" and "reference".
        """
        self._refuse_closed()
        options = options or {}
        for name in options:
            if name not in RESET_OPTIONS:
                known = ", ".join(RESET_OPTIONS)
                raise InputError(f"reset: unknown option {name!r}; known are {known}")
        check_motion(options.get("reference"))
        chosen = self._mask(options.get("reset_mask"))
        if not self._begun and not chosen.all():
            raise ResetNeeded("the first reset must begin all copies: no reset_mask")
        start, reference = options.get("initial_state"), options.get("reference")
        rows = self._rows
        if seed is None or isinstance(seed, (int, np.integer)):
            if seed is not None:
                super().reset(seed=int(seed))
            keys = None if seed is None else _seed_keys(int(seed), self.num_envs)
            rows.begin(chosen, keys, start, reference)
        elif isinstance(seed, (list, tuple, np.ndarray)):
            self._reset_each(list(seed), chosen, start, reference)
        else:
            raise InputError(f"seed: {seed!r} is neither a whole number nor a list of them")
        self._begun = True
        return rows.observation, self._info()

    def _reset_each(
        self,
        seeds: list[int | None],
        chosen: NDArray[np.bool_],
        start: Mapping[str, ArrayLike] | None,
        reference: Motion | None,
    ) -> None:
        if len(seeds) != self.num_envs:
            raise InputError(f"reset: {len(seeds)} seeds for {self.num_envs} copies")
        given = np.array([seed is not None for seed in seeds])
        keys = keys_of([0 if seed is None else _checked_seed(seed) for seed in seeds])
        if (chosen & given).any():
            self._rows.begin(chosen & given, keys, start, reference)
        if (chosen & ~given).any():
            self._rows.begin(chosen & ~given, None, start, reference)

    def step(self, actions: ArrayLike) -> Step:  # pyright: ignore[reportIncompatibleMethodOverride]
        """One control period of all copies under actions (n, 4).

        Raises
        ------
        InputError
            If an action is NaN or out of bounds by more than rounding; nothing has moved then.
        ResetNeeded
            If the first reset is missing, or, with autoreset disabled, that of a copy.
        """
        self._refuse_closed()
        if not self._begun:
            raise ResetNeeded("the episodes have not begun: call reset() first")
        rows = self._rows
        if self._mode is AutoresetMode.DISABLED and rows.results.over.any():
            copy = int(np.flatnonzero(rows.results.over.any(axis=0))[0])
            raise ResetNeeded(
                f"the episode of copy {copy} is over: call reset(options={{'reset_mask': mask}})"
            )
        found = rows.step(_actions(actions, self.num_envs))
        terminated, truncated = found.over
        info = self._info()
        if self._mode is AutoresetMode.SAME_STEP and found.over.any():
            self._add_final(info, terminated | truncated)
        return found.observation, found.reward, terminated, truncated, info

    def _info(self) -> dict[str, Any]:
        return self._described(self._rows.results.report) if self._names else {}

    def _described(self, report: NDArray[np.float64]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name in self._names:
            if name in INFO:
                found[name] = report[:, INFO[name]]
            elif name == "saturated":
                found[name] = report[:, SATURATED] != 0.0
            elif name == "reward_terms":
                found[name] = dict(zip(TERM_NAMES, report[:, TERMS].T, strict=True))
            else:
                found[name] = report[:, lanes.TIME_AT]
        return found

    def _add_final(self, info: dict[str, Any], over: NDArray[np.bool_]) -> None:
        observation, report = self._rows.final()
        info["final_obs"], info["_final_obs"] = observation, over
        if self._names:
            info["final_info"], info["_final_info"] = self._described(report), over

    def _mask(self, mask: object) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        if (
            not isinstance(mask, np.ndarray)
            or mask.shape != (self.num_envs,)
            or mask.dtype != np.bool_
            or not mask.any()
        ):
            raise InputError(
                f"reset_mask: an array ({self.num_envs},) of bool is needed, with a True in it"
            )
        return mask.copy()

    def _refuse_closed(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the environment is closed")

    # What a copy has ----------------------------------------------------------------------------

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of the single environment, of each copy: its model, reference, state ..."""
        rows = self._rows
        known = {
            "model": rows.model,
            "reference": rows.reference,
            "state": rows.state,
            "parameters": rows.parameters,
        }
        if name in known:
            return tuple(known[name](row) for row in range(self.num_envs))
        shared = {
            "action_space": self.single_action_space,
            "observation_space": self.single_observation_space,
            "period": self.period,
            "torque_limit": self.torque_limit,
            "render_mode": self.render_mode,
            "metadata": self.metadata,
            "spec": self.spec,
        }
        if name not in shared:
            raise AttributeError(f"a copy has no attribute {name!r}; known: {[*known, *shared]}")
        return (shared[name],) * self.num_envs

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """The result of a method of the single environment for each copy; an attribute as it is."""
        if name == "to_action":
            return (self.to_action(*args, **kwargs),) * self.num_envs
        return self.get_attr(name)

    def to_action(self, wheel_torque: ArrayLike) -> NDArray[np.float64]:
        """Actions (..., 4) that command wheel torques (..., 4) [N m], clipped to the limit."""
        return self._rows.setup.actuation.to_action(wheel_torque)

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self._rows.setup.period

    @property
    def torque_limit(self) -> float:
        """Wheel torque [N m] that an action of 1 commands."""
        return self._rows.setup.actuation.torque_limit

    @property
    def rows(self) -> Batch:
        """What moves the copies."""
        return self._rows

    @property
    def bytes_a_copy(self) -> int:
        """Memory of a copy between steps; arrays that were handed out are not counted."""
        return self._rows.bytes_a_row


def _actions(actions: ArrayLike, count: int) -> NDArray[Any]:
    """The actions as C-contiguous rows (n, 4), single or double; no copy where they are so."""
    if (
        isinstance(actions, np.ndarray)
        and actions.shape == (count, 4)
        and actions.dtype in (np.float32, np.float64)
        and actions.flags.c_contiguous
    ):
        return actions
    return action_rows(actions, count, single=False)


def _mode(given: str | AutoresetMode) -> AutoresetMode:
    try:
        return given if isinstance(given, AutoresetMode) else AutoresetMode(given)
    except ValueError:
        known = ", ".join(repr(mode.value) for mode in AutoresetMode)
        raise InputError(f"autoreset_mode: {given!r} is none of {known}") from None


def _names(wanted: str | Sequence[str]) -> tuple[str, ...]:
    if wanted == "all":
        return INFO_NAMES
    names = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for name in names:
        if name not in INFO_NAMES:
            raise InputError(
                f"info: unknown name {name!r}; known are {', '.join(INFO_NAMES)}, or 'all'"
            )
    return names


def _checked_seed(seed: object) -> int:
    return whole_number("seed", seed, least=0)


def _seed_keys(seed: int, count: int) -> NDArray[np.int64]:
    first = np.uint64(_checked_seed(seed) & (2**64 - 1))
    return (first + np.arange(count, dtype=np.uint64)).view(np.int64)
