"""YouBotTracking-v0: follow a body twist with the torques of four mecanum wheels."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, DTypeLike, NDArray

from youbot_env.contact.settings import Contact
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.motions.base import Motion
from youbot_env.physics.geometry import WHEELS, Geometry
from youbot_env.tracking import randomisation
from youbot_env.tracking.actuation import action_rows
from youbot_env.tracking.batch import NONE_HELD, Batch, StepInfo
from youbot_env.tracking.contact_row import ContactRow
from youbot_env.tracking.options import check_motion, refuse_unknown, tracking_setup
from youbot_env.tracking.setup import Setup

RESET_OPTIONS = ("initial_state", "reference")


class YouBotTrackingEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """
    ## Description
    A mecanum platform (KUKA youBot) follows a body twist, a sum of sines on each axis, by the
    torques of its four wheels. It moves as an identified model says: the paper's seven parameters
    and whatever effects the model file holds. Control runs at 100 Hz; in between the model is
    integrated by Runge-Kutta steps to 1e-6 m/s. With `plant="contact"` (extra `mujoco`) bodies
    with the model's parameters move in MuJoCo instead: gravity, rollers, friction with the floor.

    Wheel order: front left, front right, back left, back right (fl, fr, bl, br). Body frame:
    X forward, Y left, yaw counter-clockwise. SI units.

    ## Action Space
    `Box(-1, 1, (4,), float32)`: wheel torque over the torque limit.

    | Num | Action                | Min | Max | Torque at 1                     |
    |-----|-----------------------|-----|-----|---------------------------------|
    | 0   | front left wheel, fl  | -1  | 1   | `torque_limit`, 2.008 N m       |
    | 1   | front right wheel, fr | -1  | 1   | 0.0335 N m/A (EC 45 flat motor) |
    | 2   | back left wheel, bl   | -1  | 1   | x 2.32 A (nominal current)      |
    | 3   | back right wheel, br  | -1  | 1   | x 9405/364 (gear)               |

    Actions count in single precision. One that is NaN, or outside by more than rounding (1e-6),
    is an `InputError` and moves nothing: a controller that asks for more must clip, and so know
    that it saturates (`env.unwrapped.to_action(torque)` does both).

    ## Observation Space
    `Box(-5, 5, (25,), float32)`; the size is 6 + 3 `preview` + 4 `action_history`. A twist is
    divided by physical limits: 0.8 m/s, 0.8 m/s (youBot's top speed) and 2.62 rad/s (yaw rate at
    the wheels' top speed of 21.3 rad/s; it follows the model's geometry). Values are cut at +-5.

    | Num     | Observation                                  | Unit before scaling  |
    |---------|----------------------------------------------|----------------------|
    | 0 - 2   | measured twist VX, VY, W from wheel speeds   | m/s, m/s, rad/s      |
    | 3 - 5   | reference twist now                          | m/s, m/s, rad/s      |
    | 6 - 20  | reference twist 1 to `preview` periods ahead | m/s, m/s, rad/s      |
    | 21 - 24 | last action; older ones follow it            | -                    |

    ## Rewards
    The weighted mean of five terms, so always within [0, 1], and 1 for perfect tracking without
    effort. Each term is `tolerance(x, margin) = 1 / (1 + 9 (x / margin)^2)`: 1 at x = 0 and 0.1
    at the margin.

    | Term       | Weight | x                               | Margin    |
    |------------|--------|---------------------------------|-----------|
    | velocity_x | 0.30   | reference VX - true VX          | 0.1 m/s   |
    | velocity_y | 0.30   | reference VY - true VY          | 0.1 m/s   |
    | yaw_rate   | 0.30   | reference W - true W            | 0.3 rad/s |
    | effort     | 0.05   | root mean square of the action  | 1         |
    | smoothness | 0.05   | the same of the action's change | 1         |

    ## Starting State
    At rest at the world's origin, unless `initial_state` says otherwise. The reference starts from
    rest over `ramp` seconds. A delayed actuator's queue holds zero torque.

    ## Episode End
    Truncation: after `episode_length` seconds (10 s, 1000 steps); `max_episode_steps` of
    `gym.make` can end it before that, not after. Termination: only when the twist is not finite or
    beyond 5 times its scale (4 m/s, 13 rad/s), where no platform can be.

    ## Information
    | Key                                         | Shape   | Meaning                              |
    |---------------------------------------------|---------|--------------------------------------|
    | `tracking_error`                            | (3,)    | reference - true twist               |
    | `twist`, `pose`, `wheel_angle`              | 3,3,4   | true state; pose is x, y, yaw        |
    | `reference_twist`, `reference_acceleration` | (3,)    | the reference at this instant        |
    | `measured_twist`, `wheel_speed`             | 3, 4    | as the sensors tell                  |
    | `commanded_torque`                          | (4,)    | the action in N m                    |
    | `applied_torque`                            | (4,)    | acts at the wheels, after delay, lag |
    | `saturated`                                 | (4,)    | whether the action is at its bound   |
    | `held`                                      | (4,)    | as `to_action` was told, else False  |
    | `reward_terms`                              | dict    | each term, unweighted                |
    | `parameters`                                | dict    | this episode's model                 |
    | `time`                                      | float   | since reset [s]                      |

    ## Arguments
    ```python
    env = gym.make(
        "youbot_env:YouBotTracking-v0",
        model="model.json",
        wheel_speed_noise=0.01,
        encoder_ticks=103_352,
        delay=1,
        randomise="covariance",
    )
    ```

    | Argument             | Default          | Meaning                                            |
    |----------------------|------------------|----------------------------------------------------|
    | `model`              | "paper"          | model file, shipped model's name, or `Model`       |
    | `effects`            | None             | effects to add: `{name: {parameter: value}}`       |
    | `plant`              | "model"          | "contact": MuJoCo; or its settings, `Contact(...)` |
    | `lag`                | None             | time constant [s] of the effect actuator_lag       |
    | `delay`              | 0                | whole control periods by which torques act late    |
    | `torque_limit`       | None             | N m at an action of 1; None: the model's, 2.008    |
    | `wheel_speed_noise`  | 0                | standard deviation [rad/s] of each wheel's speed   |
    | `encoder_ticks`      | None             | counts per wheel turn; youBot: 103,352             |
    | `randomise`          | None             | "covariance", or `{name: (low, high)}`, see below  |
    | `reference`          | None             | a `Motion` to follow in every episode              |
    | `band`, `tones`      | (0.5, 3), 7      | reference: frequencies [rad/s], tones per axis     |
    | `amplitude`          | (0.22, 0.18, 0.6)| peaks of VX, VY [m/s] and W [rad/s]                |
    | `ramp`               | 1.5              | reference: smooth start [s]                        |
    | `preview`            | 5                | coming reference samples that are observed         |
    | `action_history`     | 1                | past actions that are observed                     |
    | `initial_state`      | None             | twist, pose, wheel_angle, torque, time by name     |
    | `episode_length`     | 10.0             | s                                                  |
    | `control_rate`       | 100.0            | Hz                                                 |
    | `reward_weights`     | None             | weights by term, others keep their default         |
    | `reward_margins`     | None             | margins by term, others keep their default         |
    | `dtype`              | "float64"        | "float32": half the memory, docs/environment.md    |
    | `render_mode`        | None             | "rgb_array" or "human" (needs the extra `render`)  |

    A bound of `randomise` is a number in SI units or a share of the model's own value: `{"aX":
    (-0.02, 0.02), "m0": ("80%", "120%"), "floor_tilt.tilt_x": (0, 0.02)}`. Draws are uniform;
    what is not physical is drawn again.

    `reset(options={"initial_state": {...}, "reference": motion})` overrides both for one episode.
    The same seed gives the same episode to the bit, alone or as a row of any vector environment.
    Model, reference and noise are drawn from separate streams of a counter-based generator
    (Philox4x32-10): with noise on, a seed still gives the same reference.

    ## Version History
    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 100}
    unwrapped: YouBotTrackingEnv

    def __init__(
        self,
        model: str | os.PathLike[str] | Model = "paper",
        *,
        effects: randomisation.Effects | None = None,
        plant: str | Contact = "model",
        lag: float | None = None,
        delay: int = 0,
        torque_limit: float | None = None,
        wheel_speed_noise: float = 0.0,
        encoder_ticks: float | None = None,
        randomise: randomisation.Ranges | str | None = None,
        reference: Motion | None = None,
        band: tuple[float, float] = (0.5, 3.0),
        tones: int = 7,
        amplitude: Sequence[float] = (0.22, 0.18, 0.6),
        ramp: float = 1.5,
        preview: int = 5,
        action_history: int = 1,
        initial_state: Mapping[str, ArrayLike] | None = None,
        episode_length: float = 10.0,
        control_rate: float = 100.0,
        reward_weights: Mapping[str, float] | None = None,
        reward_margins: Mapping[str, float] | None = None,
        dtype: DTypeLike = "float64",
        render_mode: str | None = None,
        **unknown: Any,
    ) -> None:
        refuse_unknown(unknown)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode: {render_mode!r} is none of 'human', 'rgb_array', None")
        setup = tracking_setup(
            model=model,
            effects=effects,
            plant=plant,
            lag=lag,
            delay=delay,
            torque_limit=torque_limit,
            wheel_speed_noise=wheel_speed_noise,
            encoder_ticks=encoder_ticks,
            randomise=randomise,
            reference=reference,
            band=band,
            tones=tones,
            amplitude=amplitude,
            ramp=ramp,
            preview=preview,
            action_history=action_history,
            initial_state=initial_state,
            episode_length=episode_length,
            control_rate=control_rate,
            reward_weights=reward_weights,
            reward_margins=reward_margins,
            dtype=dtype,
        )
        self._rows = Batch(setup) if setup.contact is None else ContactRow(setup)
        self._steps_left = 0
        self._action = np.zeros((1, 4), np.float32)
        self._parameters: dict[str, float] = {}
        self._held = NONE_HELD
        self._renderer: Any = None
        self.render_mode = render_mode
        # A copy: the class's own dictionary is shared by all environments.
        self.metadata = {**type(self).metadata, "render_fps": max(1, round(1.0 / setup.period))}
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        shape = (setup.task.observation_size,)
        limit = setup.task.twist_limit
        self.observation_space = spaces.Box(-limit, limit, shape, np.float32)
        if render_mode is not None:
            self._renderer = _renderer(setup, self._rows.geometry, self.metadata)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; ``options`` may hold "initial_state" and "reference"."""
        super().reset(seed=seed)
        options = options or {}
        for name in options:
            if name not in RESET_OPTIONS:
                known = ", ".join(RESET_OPTIONS)
                raise InputError(f"reset: unknown option {name!r}; known are {known}")
        check_motion(options.get("reference"))
        rows = self._rows
        rows.begin_alone(
            seed, self.np_random, options.get("initial_state"), options.get("reference")
        )
        self._steps_left = rows.setup.steps
        self._held = NONE_HELD
        self._parameters = rows.parameters(0)
        info = self._info()
        if self._renderer is not None:
            self._renderer.begin(info)
            self._show_if_human()
        return rows.observation[0], info

    def _info(self) -> dict[str, Any]:
        return StepInfo(self._rows.results.report[0], self._parameters)

    def step(
        self, action: ArrayLike
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One control period under the action (4,).

        Raises
        ------
        InputError
            If the action is no four numbers from -1 to 1; nothing has moved then.
        ResetNeeded
            If the episode is over or has not begun.
        """
        if self._steps_left == 0:
            raise ResetNeeded("the episode is over, or has not begun: call reset() first")
        held, self._held = self._held, NONE_HELD
        if type(action) is np.ndarray and action.dtype == np.float32 and action.shape == (4,):
            self._action[0] = action
            results = self._rows.step(self._action)
        else:
            results = self._rows.step(action_rows(action, 1, single=True))
        self._steps_left -= 1
        truncated = self._steps_left == 0
        terminated = bool(results.over[0, 0])
        # A later step without a reset must raise.
        if terminated:
            self._steps_left = 0
        info: dict[str, Any] = StepInfo(results.report[0], self._parameters, held)
        if self._renderer is not None:
            self._renderer.follow(info)
            self._show_if_human()
        return results.observation[0], float(results.reward[0]), terminated, truncated, info

    def _show_if_human(self) -> None:
        if self.render_mode == "human":
            self._renderer.show()

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The frame (H, W, 3) uint8 for "rgb_array"; "human" draws by itself as it steps."""
        if self._renderer is None:
            gym.logger.warn('render() needs a render mode: gym.make(..., render_mode="rgb_array")')
            return None
        if self.render_mode == "human":
            return self._renderer.show()
        return self._renderer.frame()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()

    def to_action(
        self, wheel_torque: ArrayLike, held: Sequence[bool] | None = None
    ) -> NDArray[np.float64]:
        """The action (4,) that commands wheel torques (4,) [N m], clipped to the torque limit.

        ``held``: (4,) the wheels whose torque is an old one, because their measurement was lost
        (``KinematicControl.held``); ``info["held"]`` of the next step tells them.

        Raises
        ------
        InputError
            If ``held`` does not tell of four wheels.
        """
        if held is not None:
            told = tuple(bool(wheel) for wheel in held)
            if len(told) != len(WHEELS):
                raise InputError(f"held: {len(told)} values, expected 4 (fl, fr, bl, br)")
            self._held = told
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
    def model(self) -> Model:
        """The plant of this episode: as drawn, with the effects added."""
        return self._rows.model(0)

    @property
    def reference(self) -> Motion | None:
        """The motion that this episode follows, None before the first reset."""
        return self._rows.reference(0)

    @property
    def state(self) -> NDArray[np.float64]:
        """(S,), a copy, in the order of ``model.structure.state_names``."""
        return self._rows.state(0)


def _renderer(setup: Setup, geometry: Geometry, metadata: Mapping[str, Any]) -> Any:
    from youbot_env.tracking.rendering import Renderer

    return Renderer(geometry, setup.actuation.torque_limit, setup.period, metadata["render_fps"])
