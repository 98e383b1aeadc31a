"""From an environment's options to the setup that its platforms are built from."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from youbot_env.contact.settings import Contact, contact_named
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import Motion
from youbot_env.motions.limits import MotionLimits
from youbot_env.tracking import randomisation
from youbot_env.tracking.actuation import Actuation
from youbot_env.tracking.sensors import Sensors
from youbot_env.tracking.setup import Setup, episode_steps
from youbot_env.tracking.task import TrackingTask


def tracking_setup(
    model: str | os.PathLike[str] | Model = "paper",
    *,
    effects: Mapping[str, Mapping[str, float]] | None = None,
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
) -> Setup:
    """The options of ``YouBotTracking-v0``, see there, as a checked ``Setup``.

    Raises
    ------
    InputError
        If an option cannot be.
    """
    check_motion(reference)
    rate = finite("control_rate", control_rate, positive=True)
    added: dict[str, Any] = dict(effects or {})
    if lag is not None:
        added["actuator_lag"] = {"time_constant": finite("lag", lag, positive=True)}
    known = load_model(model)
    steps, contact = episode_steps(episode_length, 1.0 / rate), contact_named(plant)
    sensors = Sensors(wheel_speed_noise, encoder_ticks)
    if single := _is_single(dtype):
        _refuse_doubles(contact, sensors, MotionLimits.of(known.geometry), steps / rate)
    if torque_limit is None:
        torque_limit = known.geometry.max_wheel_torque
    return Setup(
        source=randomisation.source(randomise, known, added),
        task=TrackingTask(
            band=band,
            tones=tones,
            amplitude=amplitude,
            ramp=ramp,
            preview=preview,
            action_history=action_history,
            reward_weights=reward_weights or {},
            reward_margins=reward_margins or {},
        ),
        actuation=Actuation(torque_limit, delay),
        sensors=sensors,
        period=1.0 / rate,
        steps=steps,
        start=initial_state or {},
        reference=reference,
        contact=contact,
        single=single,
    )


def _is_single(dtype: DTypeLike) -> bool:
    """Whether numbers are single; InputError for what is neither single nor double."""
    try:
        kind = np.dtype(dtype)
    except TypeError:
        kind = None
    if kind not in (np.float32, np.float64):
        raise InputError(f"dtype: {dtype!r} is neither 'float64' nor 'float32'")
    return kind == np.float32


def _refuse_doubles(
    contact: Contact | None, sensors: Sensors, limits: MotionLimits, seconds: float
) -> None:
    """InputError for what needs double precision."""
    if contact is not None:
        raise InputError("dtype: a plant with real contacts is in float64")
    known = float(np.spacing(np.float32(limits.wheel_speed * seconds)))
    if sensors.resolution and known > sensors.resolution / 4:
        raise InputError(
            f"dtype: after {seconds:g} s at full speed float32 holds a wheel's angle to "
            f"{known:.1g} rad, too coarse for counts of {sensors.resolution:.1g} rad; take "
            "float64, a shorter episode or fewer ticks"
        )


def check_motion(reference: object) -> None:
    """InputError for what is neither a motion nor None."""
    if reference is not None and not isinstance(reference, Motion):
        raise InputError(
            f"reference: {reference!r} is not a Motion (see youbot_env.motions.calibration)"
        )


OPTIONS = ("model", *(tracking_setup.__kwdefaults__ or {}))
"""Names of the options, in the order of the environment's table."""


def refuse_unknown(options: Mapping[str, Any]) -> None:
    """InputError for the first of ``options`` that is none, with the closest name that exists."""
    for name in options:
        if name in OPTIONS:
            continue
        if name == "max_episode_steps":  # Gymnasium's own; vector environments are handed it
            raise InputError(f"YouBotTracking-v0: {name}: give episode_length, in seconds, instead")
        close = difflib.get_close_matches(name, OPTIONS, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(OPTIONS)}"
        raise InputError(f"YouBotTracking-v0: unknown option {name!r}; {hint}")
