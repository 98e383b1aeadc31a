"""Conditions under which a policy is trained and judged: plant, loop, references, reward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from youbot_env.errors import InputError
from youbot_env.model.model import BASE_UNITS, Model
from youbot_env.physics import hardware
from youbot_env.tracking import randomisation

SPREAD = ("95%", "105%")
"""Range of each base parameter, for a model without a covariance."""

REWARD_MARGINS = {"velocity_x": 0.02, "velocity_y": 0.02, "yaw_rate": 0.06, "smoothness": 0.3}
"""Narrower than the environment's, which give good and very good policies nearly one reward."""

REWARD_WEIGHTS = {"effort": 0.0, "smoothness": 0.02}
"""No effort: the reference determines it. A little smoothness keeps noise out of the torques."""


@dataclass(frozen=True)
class Conditions:
    """Options of ``YouBotTracking-v0`` that training sets; see there.

    The defaults are those of the shipped policies' training. All values can be stored as JSON, so
    that an interrupted run continues under the same conditions.

    Raises
    ------
    InputError
        When ``platforms.tracking_setup`` is called, if a value is out of its range.
    """

    delay: int = 1
    lag: float | None = None
    wheel_speed_noise: float = 0.01
    encoder_ticks: float | None = hardware.ENCODER_TICKS
    torque_limit: float = hardware.MAX_WHEEL_TORQUE
    control_rate: float = 100.0
    episode_length: float = 10.0
    band: tuple[float, float] = (0.5, 3.0)
    tones: int = 7
    amplitude: tuple[float, float, float] = (0.22, 0.18, 0.6)
    ramp: float = 1.5
    preview: int = 5
    action_history: int = 1
    reward_weights: Mapping[str, float] = field(default_factory=lambda: dict(REWARD_WEIGHTS))
    reward_margins: Mapping[str, float] = field(default_factory=lambda: dict(REWARD_MARGINS))

    def to_dict(self) -> dict[str, Any]:
        """JSON-able; ``Conditions(**this)`` is the same again."""
        return asdict(self)


CONDITION_NAMES = tuple(field.name for field in fields(Conditions))


def ranges_from(text: str, model: Model) -> randomisation.Ranges | str | None:
    """Ranges of the plant's parameters, from the option `--randomise`.

    Parameters
    ----------
    text : "covariance", "none", "auto" (the covariance where the model has one, else every base
        parameter from 95 to 105 %), or ranges such as ``m0=90%:110%,aX=-0.02:0.02``

    Raises
    ------
    InputError
        If a range is not written like that.
    """
    if text == "auto":
        text = "spread" if model.covariance is None else "covariance"
    if text == "spread":
        return dict.fromkeys(BASE_UNITS, SPREAD)
    if text in ("covariance", "none"):
        return text if text == "covariance" else None
    return dict(_range(part) for part in text.split(","))


def _range(text: str) -> tuple[str, tuple[float | str, float | str]]:
    name, equals, bounds = text.partition("=")
    low, colon, high = bounds.partition(":")
    if not (equals and colon and name.strip()):
        raise InputError(
            f"randomise: {text!r} is none of covariance, none, auto, nor a range such as "
            "m0=90%:110%"
        )
    return name.strip(), (_bound(low, text), _bound(high, text))


def _bound(word: str, text: str) -> float | str:
    word = word.strip()
    if word.endswith("%"):
        return word
    try:
        return float(word)
    except ValueError:
        raise InputError(f"randomise: {text!r}: {word!r} is neither a number nor a share") from None
