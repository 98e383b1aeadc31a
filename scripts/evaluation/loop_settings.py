"""The loop that controllers are compared in, as a user states it."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.interface import Loop
from youbot_env.errors import finite


@dataclass(frozen=True)
class LoopSettings:
    """The loop between a controller and a plant, as a user states it.

    Attributes
    ----------
    rate : of control [Hz]
    delay : whole control periods by which commands act late
    noise : standard deviation of a measured wheel speed [rad/s], on top of its encoder's counts
    pose : whether the controller is shown the true pose; otherwise it has its wheels alone

    Raises
    ------
    InputError
        If a number cannot be.
    """

    rate: float = 100.0
    delay: int = 1
    noise: float = 0.01
    pose: bool = False

    def __post_init__(self) -> None:
        finite("rate [Hz]", self.rate, positive=True)
        for name in ("delay", "noise"):
            finite(name, getattr(self, name), least=0.0)

    def known(self) -> Loop:
        """What a controller's designer knows of it; the drives' lag is the model's to know.

        An encoder's counts over a period are the mean speed over it, so half a period old.
        """
        period = 1.0 / self.rate
        return Loop(
            sample_time=period,
            delay=self.delay * period,
            measurement_delay=0.5 * period,
            speed_noise=self.noise,
        )
