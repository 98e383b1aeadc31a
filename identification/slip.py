"""The no-slip identity of four mecanum wheels as a number that a log can fail."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from identification.log import Log
from identification.wheel_checks import slip_ratio
from youbot_env.geometry import WHEELS

CLEAR = 1.5
"""Times the noise from which on the identity is said to fail; noise is known to a few percent."""

NEGLIGIBLE = 1e-3
"""Ratio below which slip does not matter, however small the noise."""


@dataclass(frozen=True)
class Slip:
    """phi_1' + phi_2' - phi_3' - phi_4' = 0 checked on a log.

    ratio : share (root mean square) of the wheel speeds that no rigid motion explains
    noise : what white noise of the speeds alone would make of it
    """

    ratio: float
    noise: float

    @property
    def exceeds_noise(self) -> bool:
        """Whether there is more than noise."""
        return self.ratio > max(CLEAR * self.noise, NEGLIGIBLE)

    def to_dict(self) -> dict[str, float | bool]:
        """JSON form."""
        return {**asdict(self), "exceeds_noise": self.exceeds_noise}


def slip_of(log: Log) -> Slip | None:
    """The identity on a log; None for a mechanism that has no such four wheels."""
    if tuple(log.joints) != WHEELS:
        return None
    usual = float(np.sqrt((log.velocity**2).sum(axis=1).mean()))
    noise = float(np.sqrt((log.speed_noise**2).mean()))
    return Slip(slip_ratio(log.velocity), noise / max(usual, 1e-300))
