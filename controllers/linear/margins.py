"""Gain and phase margins of a loop of three axes, for one loop or for many at once.

An axis is opened at its force command while the other two stay closed. Of a kinematic control,
whose four wheel loops share three degrees of freedom, these are the stricter loops: one wheel's own
loop, with the other three closed, bears more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controllers.interface import Array
from youbot_env.errors import check_settings, optional_library

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class MarginSettings:
    """The stability margins that a design must keep, and the grid on which they are found.

    ``gain_margin`` and ``phase_margin`` hold at each axis.
    """

    gain_margin: float = field(
        default=6.0,
        metadata={
            "unit": "dB",
            "reason": "a textbook's value: the loop bears half or twice its gain",
        },
    )
    phase_margin: float = field(
        default=45.0,
        metadata={
            "unit": "degrees",
            "reason": "a textbook's value: a step overshoots by about a quarter",
        },
    )
    frequency_count: int = field(
        default=400,
        metadata={
            "unit": "1",
            "reason": "equal steps of log(frequency); crossings are interpolated between them",
        },
    )
    lowest_frequency_share: float = field(
        default=1e-4,
        metadata={
            "unit": "of Nyquist's frequency",
            "reason": "below it integral action alone decides, far from both crossings",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, eq=False)
class Margins:
    """What each axis' loop bears, opened at its force command while the other two stay closed.

    Attributes
    ----------
    gain : (..., 3) gain margin [dB] of F_X, F_Y, M_W: the smallest change of that axis' gain, up or
        down, that reaches the stability limit; inf where none does
    phase : (..., 3) phase margin [degrees], inf where the loop's gain never crosses one
    """

    gain: Array
    phase: Array

    def to_dict(self) -> dict[str, list[float]]:
        """By axis, as a result file holds them."""
        return {"gain_db": self.gain.tolist(), "phase_degrees": self.phase.tolist()}


def python_control() -> Any:
    """The module ``control``, or InputError that names the extra."""
    return optional_library("control", "control", "this design needs python-control")


def control_margins(loop_gain: Complex, frequency: Array) -> Margins:
    """The margins of L (w, 3, 3) as python-control finds them (extra: control)."""
    control, one = python_control(), opened(loop_gain)
    found = [control.margin(control.frd(one[:, axis], frequency))[:2] for axis in range(3)]
    gain, phase = np.array(found, float).T
    return Margins(np.abs(20.0 * np.log10(gain)), phase)


def frequency_grid(period: float, settings: MarginSettings = MarginSettings()) -> Array:
    """(w,) [rad/s] up to Nyquist's frequency."""
    shares = np.geomspace(settings.lowest_frequency_share, 1.0, settings.frequency_count)
    return shares * np.pi / period


def opened(loop_gain: Complex) -> Complex:
    """(..., w, 3): each axis' loop of L (..., w, 3, 3) with the others closed.

    Written at the force command: u = -L u. The other axes answer u_o = -(1 + L_oo)^-1 L_oi u_i.
    """
    axes = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        # 1 + L of the two other axes.
        (a, b), (c, d) = [[loop_gain[..., i, j] + (i == j) for j in others] for i in others]
        first, second = (loop_gain[..., i, axis] for i in others)
        to_first, to_second = (loop_gain[..., axis, i] for i in others)
        # Cramer's rule takes a twentieth of the time of a solver that is called for each frequency.
        back = to_first * (d * first - b * second) + to_second * (a * second - c * first)
        axes.append(loop_gain[..., axis, axis] - back / (a * d - b * c))
    return np.stack(axes, axis=-1)


def margins(loop_gain: Complex) -> Margins:
    """Margins of L (..., w, 3, 3) over a fine, rising grid of frequencies.

    Crossings are found between the grid's points, linear in log(gain) and phase. They speak of
    stability only where the closed loop is stable.
    """
    one = opened(loop_gain)
    log_gain = np.log(np.abs(one))
    phase = np.unwrap(np.angle(one), axis=-2)
    # Unwrapped above, so that no jump of 360 degrees looks like a crossing.
    half_turns = (phase - np.pi) / (2 * np.pi)  # whole where the phase is -180 degrees, mod 360
    at_phase = _at_crossings(half_turns - np.round(half_turns), log_gain, limit=0.25)
    # The angle of -L is the distance of L's phase from -180 degrees, wrapped.
    at_gain = _at_crossings(log_gain, np.angle(-one), limit=np.inf)
    return Margins(
        gain=20 / np.log(10) * np.abs(at_phase).min(axis=-2),
        phase=np.degrees(np.abs(at_gain).min(axis=-2)),
    )


def _at_crossings(crossing: Array, value: Array, limit: float) -> Array:
    """``value`` where ``crossing`` passes zero between rows, inf elsewhere; (..., w - 1, 3).

    A step larger than ``limit`` is a jump from one branch to the next, not a crossing.
    """
    before, after = crossing[..., :-1, :], crossing[..., 1:, :]
    step = before - after
    passes = (before * after <= 0) & (np.abs(step) < limit) & (step != 0)
    # np.where evaluates both branches, so the division must be safe everywhere.
    share = np.where(passes, before / np.where(step == 0, 1.0, step), 0.0)
    between = value[..., :-1, :] + share * np.diff(value, axis=-2)
    return np.where(passes, between, np.inf)
