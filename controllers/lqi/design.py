"""Linear quadratic design of a tracker with integral action, delays and drives in its state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from controllers.interface import Array, Loop
from controllers.linear.linear_system import (
    LinearSystem,
    closed,
    effective_mass,
    sampled_platform,
)
from controllers.linear.margins import (
    Margins,
    MarginSettings,
    frequency_grid,
    margins,
    python_control,
)
from youbot_env.errors import InputError, finite
from youbot_env.model.model import Model


@dataclass(frozen=True)
class LQISettings(MarginSettings):
    """What an LQI design is asked for, and how finely it is sought."""

    damping: float = field(
        default=0.75,
        metadata={
            "unit": "1",
            "reason": "of the weights: more buys little accuracy for much noise in the torques",
        },
    )
    slowest_bandwidth: float = field(
        default=0.3,
        metadata={
            "unit": "rad/s",
            "reason": "slower than any platform is driven: where this fails, all does",
        },
    )
    fastest_bandwidth_share: float = field(
        default=0.5,
        metadata={
            "unit": "of the sample rate",
            "reason": "the upper end of the search: times the sample time a bandwidth is no larger",
        },
    )
    halvings: int = field(
        default=14,
        metadata={"unit": "1", "reason": "the bandwidth is found to 0.03 %"},
    )


@dataclass(frozen=True)
class Weights:
    """Of the cost, a sum over samples of |e|^2 q_e + |q|^2 q_q + |M^-1 (F - F_r)|^2.

    e: error of the twist [m/s, rad/s], q: its integral, F - F_r: force beyond the reference's
    steady one. A force counts as the acceleration that it gives, so that heavy and light axes are
    alike. Of a platform without friction or delay, q_e = (4 damping^2 - 2) b^2 and q_q = b^4 give
    each axis the poles of s^2 + 2 damping b s + b^2.

    Attributes
    ----------
    bandwidth : b [rad/s]
    damping : at least sqrt(1/2), so that no weight is negative

    Raises
    ------
    InputError
        If a number cannot be.
    """

    bandwidth: float
    damping: float = LQISettings.damping

    def __post_init__(self) -> None:
        finite("LQI bandwidth", self.bandwidth, positive=True)
        if finite("LQI damping", self.damping, positive=True) < np.sqrt(0.5) - 1e-12:
            raise InputError(f"LQI damping: {self.damping:g} must be at least 0.707")

    @property
    def error(self) -> float:
        """q_e [1/s^2]."""
        return max(4.0 * self.damping**2 - 2.0, 0.0) * self.bandwidth**2

    @property
    def integral(self) -> float:
        """q_q [1/s^4]."""
        return self.bandwidth**4


class NoOptimumError(InputError):
    """The Riccati equation of these weights has no solution that a computer finds."""


class LQIDesign(NamedTuple):
    """Numbers of the loop; S states: twist, drives, commands and measurements on their way.

    Attributes
    ----------
    plant : (S,) the sampled platform, its output the twist as it will be measured
    gain : (3, S) on the state's distance from the reference's, 0 on measurements on their way
    integral : (3, 3) on the integral of the error
    state : (S, 3) steady state of a constant reference twist (N_x)
    force : (3, 3) steady force of a constant reference twist (N_u)
    """

    plant: LinearSystem
    gain: Array
    integral: Array
    state: Array
    force: Array


def lqi(model: Model, loop: Loop, weights: Weights) -> LQIDesign:
    """The optimal gains (extra: control), by the sampled twist model with its delays.

    Raises
    ------
    InputError
        If python-control is missing, or the cost has no minimum that a computer finds.
    """
    control = python_control()
    mass, _ = effective_mass(model)
    bare = sampled_platform(model, loop, measured=False)
    size, period = len(bare.a), loop.sample_time
    # Scaled to numbers of one size (forces as accelerations, the integral times b, the cost over
    # b^2): without it the Riccati equation of a fast loop fails.
    fast, per_force = weights.bandwidth, np.linalg.inv(mass)
    # States are twist, then forces in groups of three: drives and commands on their way.
    blocks = [np.eye(3)] + [per_force] * (size // 3 - 1)
    scale = np.asarray(block_diag(*blocks), float)
    back = np.linalg.inv(scale)
    into = scale @ bare.a @ back, scale @ bare.b @ mass
    a = np.block([[into[0], np.zeros((size, 3))], [-fast * period * bare.c @ back, np.eye(3)]])
    b = np.vstack([into[1], np.zeros((3, 3))])
    cost = np.zeros((size + 3, size + 3))
    cost[:3, :3] = weights.error / fast**2 * np.eye(3)
    cost[size:, size:] = weights.integral / fast**4 * np.eye(3)
    try:
        found = np.asarray(control.dlqr(a, b, cost, np.eye(3) / fast**2)[0], float)
    except (np.linalg.LinAlgError, ValueError, control.ControlArgument) as error:
        raise NoOptimumError(
            f"LQI: no optimal gains for this model and loop ({error}); try another bandwidth"
        ) from None
    # The controller simulates the plant with measurements on their way; the cost ignores them.
    plant = sampled_platform(model, loop)
    gain = np.zeros((3, len(plant.a)))
    gain[:, :size] = mass @ found[:, :size] @ scale
    state, force = _steady(plant)
    return LQIDesign(plant, gain, fast * mass @ found[:, size:], state, force)


def _steady(plant: LinearSystem) -> tuple[Array, Array]:
    """N_x (S, 3) and N_u (3, 3): (a - 1) N_x + b N_u = 0 and c N_x = 1."""
    size = len(plant.a)
    rows = np.block([[plant.a - np.eye(size), plant.b], [plant.c, np.zeros((3, 3))]])
    found: Array = np.asarray(
        np.linalg.solve(rows, np.vstack([np.zeros((size, 3)), np.eye(3)])), np.float64
    )
    return found[:size], found[size:]


def linear_lqi(design: LQIDesign) -> LinearSystem:
    """Reference minus measured twist (3,) to force (3,), at reference zero: for poles and margins.

    States are the model of the platform that the controller carries, and the integral.
    """
    plant, period = design.plant, design.plant.period or 0.0
    size = len(plant.a)
    seen = np.eye(3, size) - plant.c  # estimated twist = seen x + measured
    on_twist = design.gain[:, :3]
    # The measured twist replaces the model's, so the twist's gain acts on the estimate.
    rest = design.gain.copy()
    rest[:, :3] = 0.0
    c = np.hstack([-(on_twist @ seen + rest), -design.integral])
    a = np.block([[plant.a, np.zeros((size, 3))], [-period * seen, np.eye(3)]])
    b = np.vstack([np.zeros((size, 3)), period * np.eye(3)])
    into = np.vstack([plant.b, np.zeros((3, 3))])
    return LinearSystem(a + into @ c, b + into @ on_twist, c, on_twist, period)


def lqi_margins(design: LQIDesign, settings: MarginSettings | None = None) -> tuple[Margins, bool]:
    """Margins at each axis' force, and whether the loop with its own model is stable."""
    controller = linear_lqi(design)
    frequency = frequency_grid(float(design.plant.period or 0.0), settings or MarginSettings())
    gain = controller.response(frequency) @ design.plant.response(frequency)
    return margins(gain), closed(design.plant, controller).is_stable


def fastest(model: Model, loop: Loop, settings: LQISettings = LQISettings()) -> Weights:
    """The weights of the largest bandwidth that keeps the margins.

    Raises
    ------
    InputError
        If none does, or python-control is missing.
    """

    def keeps(bandwidth: float) -> bool:
        try:
            gap, stable = lqi_margins(
                lqi(model, loop, Weights(bandwidth, settings.damping)), settings
            )
        except NoOptimumError:
            return False
        enough = gap.gain.min() >= settings.gain_margin and gap.phase.min() >= settings.phase_margin
        return stable and bool(enough)

    low, high = settings.slowest_bandwidth, settings.fastest_bandwidth_share / loop.sample_time
    if not keeps(low):
        raise InputError(
            f"LQI: no bandwidth from {low:g} rad/s on keeps gain margin >= "
            f"{settings.gain_margin:g} dB and phase margin >= {settings.phase_margin:g} degrees; "
            "ask for less"
        )
    # Bisection in the logarithm, so that the relative error is the same for all bandwidths.
    for _ in range(settings.halvings):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return Weights(low, settings.damping)
