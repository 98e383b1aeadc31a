"""Inputs of a policy: the environment's observation, and linear features of it that learn fast.

No model is used: features are scaled differences, and the mix comes from the wheels' geometry.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controllers.interface import Array, Observation, Reference
from youbot_env.errors import InputError, check_settings
from youbot_env.physics.geometry import SIGN_LATERAL, SIGN_Y, Geometry

CUT = 5.0
"""The environment cuts each observed value at this many times its scale."""

WHEEL_MIX: Array = np.column_stack([np.ones(4), SIGN_LATERAL, -np.array(SIGN_Y)])
"""(4, 3): what pushes forward, left and turns to the left, for each wheel fl, fr, bl, br, where
rollers stand in X. In O it is that of the wheels in another order, and so are features made of it.
"""


def wheel_mix(geometry: Geometry) -> Array:
    """``WHEEL_MIX`` of any robot: the signs with which a twist turns the wheels."""
    return np.sign(geometry.wheel_jacobian)


@dataclass(frozen=True)
class FeatureSettings:
    """Gains that bring what a new policy sees to order one; a trained one holds its own."""

    error_gain: float = field(
        default=30.0,
        metadata={"unit": "1", "reason": "a tracking error of 1/30 of full speed is large"},
    )
    twist_gain: float = field(
        default=4.0,
        metadata={"unit": "1", "reason": "a quarter of full speed is usual"},
    )
    slope_gain: float = field(
        default=250.0,
        metadata={"unit": "1", "reason": "a change of the reference in one sample"},
    )
    curvature_gain: float = field(
        default=500.0,
        metadata={"unit": "1", "reason": "a change of that change"},
    )
    wheel_gain: float = field(
        default=50.0,
        metadata={
            "unit": "s/m",
            "reason": "of a wheel's surface speed, for what a model often lacks: dry friction, a "
            "step at rest",
        },
    )
    action_gain: float = field(
        default=4.0,
        metadata={"unit": "1", "reason": "a quarter of the torque limit is usual"},
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class Layout:
    """How ``YouBotTracking-v0`` lays out what it observes; see its docstring.

    Attributes
    ----------
    twist_scale : (VX, VY, W) [m/s, m/s, rad/s] by which twists are divided
    preview : coming reference samples
    action_history : past actions
    base_torque : whether the torque over the torque limit (4,) that the base controller asks for
        follows at the end
    """

    twist_scale: tuple[float, float, float]
    preview: int = 5
    action_history: int = 1
    base_torque: bool = False

    @property
    def size(self) -> int:
        """Numbers in an observation."""
        return 6 + 3 * self.preview + 4 * (self.action_history + self.base_torque)

    @property
    def divisors(self) -> Array:
        """(size,): by what an observation's twists are divided; 1 for its torques."""
        twists = np.tile(self.twist_scale, 2 + self.preview)
        return np.concatenate((twists, np.ones(self.size - len(twists))))

    def fill(
        self,
        seen: Array,
        observation: Observation,
        reference: Reference,
        actions: Array,
        base: Array | None,
    ) -> None:
        """Write one instant's observation, not yet divided, into ``seen`` (size,).

        ``actions`` (4 k,) are past ones, newest first; ``base`` (4,) that of the base controller.

        Raises
        ------
        InputError
            If the reference does not look far enough ahead.
        """
        coming, last = reference.preview, 6 + 3 * self.preview
        seen[:3], seen[3:6] = observation.body_twist, reference.twist
        if self.preview:
            if coming is None or len(coming) < self.preview:
                raise InputError(
                    f"policy: needs the reference {self.preview} samples ahead, "
                    f"not {0 if coming is None else len(coming)}; give Reference.preview"
                )
            seen[6:last] = coming[: self.preview].ravel()
        seen[last : last + len(actions)] = actions
        if base is not None:
            seen[-4:] = base


def plain_features(layout: Layout) -> Array:
    """(D, D): the observation as it is, for policies that were trained on it."""
    return np.eye(layout.size)


def tracking_features(
    layout: Layout,
    lever: float = Geometry().L,
    gains: FeatureSettings = FeatureSettings(),
) -> Array:
    """(F, D): error, twist, slope and curvature of the reference, past actions; all of order one.

    Torques (past actions, those of the base controller) are seen as forward, left and turn. On
    top of a controller the wheels' speeds at the floor are seen too, with ``lever`` [m], the L of
    the geometry.
    """
    see = np.eye(layout.size)
    measured, now = see[0:3], see[3:6]
    rows = [gains.error_gain * (now - measured), gains.twist_gain * now]
    last, middle = layout.preview, layout.preview // 2

    def slope(start: int, end: int) -> Array:
        first, second = (see[3 + 3 * k : 6 + 3 * k] for k in (start, end))
        return (second - first) / (end - start)

    if last >= 1:
        rows.append(gains.slope_gain * slope(0, last))
    if last >= 2:
        rows.append(gains.curvature_gain * (slope(middle, last) - slope(0, middle)))
    if layout.base_torque:
        to_wheels = WHEEL_MIX * np.array([1.0, 1.0, lever]) * layout.twist_scale
        rows.append(gains.wheel_gain * to_wheels @ now)
    # Each group of four torques is mapped back to forward, left and turn by the pseudo-inverse.
    unmix = gains.action_gain * np.linalg.pinv(WHEEL_MIX)
    for start in range(6 + 3 * last, layout.size, 4):
        rows.append(unmix @ see[start : start + 4])
    return np.vstack(rows)
