"""Geometry of a four-wheel mecanum platform and its no-slip kinematics.

`Geometry` maps arrays; the functions below it map components (numbers, arrays of one shape,
symbols) for any object with l, h, R, r, so that equations of motion are traced through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.physics.hardware import WHEELS as WHEELS
from youbot_env.physics.namespaces import N, Number, Triple

SIGN_X = (+1.0, +1.0, -1.0, -1.0)
"""x_i = SIGN_X[i] h: front wheels lie ahead of O."""

SIGN_Y = (+1.0, -1.0, +1.0, -1.0)
"""y_i = SIGN_Y[i] l: left wheels lie at positive Y."""

SIGN_LATERAL = (-1.0, +1.0, +1.0, -1.0)
"""Sign of VY in R phi_i': the tangent of the roller angle d = -45, +45, +45, -45 degrees, which is
that of the roller on the floor. Seen from above the rollers slant the other way."""

COS_ROLLER = float(np.sqrt(0.5))
"""Cosine of the 45 degree angle between a roller's axis and X."""


class Lengths(Protocol):
    """The lengths of a `Geometry` that the no-slip kinematics reads [m]."""

    @property
    def l(self) -> float: ...  # noqa: E743 - the paper's name
    @property
    def h(self) -> float: ...
    @property
    def R(self) -> float: ...
    @property
    def r(self) -> float: ...


@dataclass(frozen=True)
class Geometry:
    """Lengths and wheel mass that are known beforehand. The defaults are the KUKA youBot's.

    Attributes
    ----------
    l, h : half the track width and half the wheel base [m]
    R, r : wheel and roller radius [m]
    m1 : mass of one wheel [kg]

    Raises
    ------
    InputError
        If a length is not positive and finite, or the mass is negative.
    """

    l: float = 0.15  # noqa: E741 - the paper's name, and the model file's
    h: float = 0.2355
    R: float = 0.0475
    r: float = 0.014
    m1: float = 1.4

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, (int, float)) or not np.isfinite(value):
                raise InputError(f"geometry {field.name}: {value!r} is not a finite number")
            if value < 0 or (value == 0 and field.name != "m1"):
                raise InputError(f"geometry {field.name}: {value!r} must be positive")
            # The dataclass is frozen; __post_init__ may write only this way.
            object.__setattr__(self, field.name, float(value))

    @property
    def L(self) -> float:  # noqa: N802 - the paper's name
        """L = l + h [m], the lever arm of a wheel's rolling in the yaw equation."""
        return self.l + self.h

    @property
    def wheel_jacobian(self) -> NDArray[np.float64]:
        """(4, 3): wheel rates [rad/s] per body twist (VX, VY, W); no slip."""
        # A positive (left) turn moves the left wheels back. The arm is l + h, not l: at 45 degrees
        # the sideways motion h W of a wheel turns it as much as a forward motion does.
        yaw = [-sign * self.L for sign in SIGN_Y]
        return np.column_stack([np.ones(4), SIGN_LATERAL, yaw]) / self.R

    @property
    def roller_jacobian(self) -> NDArray[np.float64]:
        """(4, 3): rates [rad/s] of the rollers on the floor per body twist; no slip."""
        # A roller takes up the sideways speed of its wheel, VY + x_i W; VX turns none.
        lateral = -np.ones(4) / (self.r * COS_ROLLER)
        return np.column_stack([np.zeros(4), lateral, lateral * np.array(SIGN_X) * self.h])

    def wheel_speeds(self, twist: ArrayLike) -> NDArray[np.float64]:
        """Wheel rates (..., 4) [rad/s] of the body twist (..., 3) (VX, VY, W) without slip."""
        return np.asarray(twist, float) @ self.wheel_jacobian.T

    def body_twist(self, wheel_speeds: ArrayLike) -> NDArray[np.float64]:
        """Least-squares twist (..., 3) of four wheel rates (..., 4) [rad/s].

        The columns of the wheel Jacobian are orthogonal, so the projection is a mean with signs.
        """
        jacobian = self.wheel_jacobian
        # The pseudo-inverse of a matrix with orthogonal columns: each column over its squared
        # length.
        return np.asarray(wheel_speeds, float) @ (jacobian / (jacobian**2).sum(axis=0))

    def slip(self, wheel_speeds: ArrayLike) -> NDArray[np.float64]:
        """phi_1' + phi_2' - phi_3' - phi_4' (...) [rad/s]: zero as long as no wheel slips."""
        return np.asarray(wheel_speeds, float) @ np.array([1.0, 1.0, -1.0, -1.0])

    def body_force(self, wheel_torque: ArrayLike) -> NDArray[np.float64]:
        """(F_X, F_Y, M_W) (..., 3) [N, N, N m] about O of four wheel torques (..., 4) [N m]."""
        # Equal power, M . phi' = F . V: forces use the transpose of the rates' Jacobian.
        return np.asarray(wheel_torque, float) @ self.wheel_jacobian

    def wheel_torque(self, body_force: ArrayLike) -> NDArray[np.float64]:
        """Least-norm wheel torques (..., 4) [N m] that exert the body force (..., 3)."""
        jacobian = self.wheel_jacobian
        return np.asarray(body_force, float) @ (jacobian / (jacobian**2).sum(axis=0)).T


@dataclass(frozen=True)
class UnevenContacts:
    """The lengths of a geometry whose wheels roll each in its own way.

    ahead, sideways : (4) factors on what a wheel turns for the speed of its centre along X and
        along Y; roller : (4) on the rate of its roller. All are one in a nominal geometry.
    """

    l: Number  # noqa: E741 - the paper's name
    h: Number
    R: Number
    r: Number
    ahead: Sequence[Number]
    sideways: Sequence[Number]
    roller: Sequence[Number]

    @property
    def wheel_rows(self) -> tuple[Triple, ...]:
        """Rows of the wheel Jacobian: a centre at (x, y) moves at (VX - y W, VY + x W)."""
        return tuple(self._wheel_row(i) for i in range(4))

    def _wheel_row(self, i: int) -> Triple:
        ahead = self.ahead[i] / self.R
        sideways = SIGN_LATERAL[i] * self.sideways[i] / self.R
        x, y = SIGN_X[i] * self.h, SIGN_Y[i] * self.l
        return ahead, sideways, sideways * x - ahead * y

    @property
    def roller_rows(self) -> tuple[Triple, ...]:
        """The same of the rollers on the floor."""
        factors = [-1.0 * factor / (self.r * COS_ROLLER) for factor in self.roller]
        return tuple((0.0, f, f * (SIGN_X[i] * self.h)) for i, f in enumerate(factors))


def _products(rows: Sequence[Triple], vector: Sequence[Number]) -> tuple[Number, ...]:
    a, b, c = vector
    return tuple(row[0] * a + row[1] * b + row[2] * c for row in rows)


def _transposed_product(rows: Sequence[Triple], vector: Sequence[Number]) -> Triple:
    one, two, three, four = rows
    a, b, c, d = vector
    return tuple(  # type: ignore[return-value]
        one[k] * a + two[k] * b + three[k] * c + four[k] * d for k in range(3)
    )


def _solved(rows: Sequence[Triple], right: Triple) -> Triple:
    """x of (rows^T rows) x = right, by the adjugate: it has no branch, so it works on symbols."""
    (a, b, c), (_, d, e), (_, _, f) = (
        _transposed_product(rows, [row[k] for row in rows]) for k in range(3)
    )
    p, q, r = right
    df, ce, be = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * df + b * ce + c * be
    return (
        (df * p + ce * q + be * r) / determinant,
        (ce * p + (a * f - c * c) * q + (b * c - a * e) * r) / determinant,
        (be * p + (b * c - a * e) * q + (a * d - b * b) * r) / determinant,
    )


def wheel_rates(geometry: Lengths | UnevenContacts, twist: Sequence[N]) -> tuple[N, ...]:
    """No slip: the four wheel rates [rad/s] of a body twist."""
    if isinstance(geometry, UnevenContacts):
        return cast("tuple[N, ...]", _products(geometry.wheel_rows, twist))
    vx, vy, wz = twist
    lever = geometry.l + geometry.h
    return tuple(
        (vx + SIGN_LATERAL[i] * vy - SIGN_Y[i] * lever * wz) / geometry.R for i in range(4)
    )


def roller_rates(geometry: Lengths | UnevenContacts, twist: Sequence[N]) -> tuple[N, ...]:
    """No slip: rates [rad/s] of the four rollers on the floor."""
    if isinstance(geometry, UnevenContacts):
        return cast("tuple[N, ...]", _products(geometry.roller_rows, twist))
    _, vy, wz = twist
    return tuple(-(vy + SIGN_X[i] * geometry.h * wz) / (geometry.r * COS_ROLLER) for i in range(4))


def body_force(geometry: Lengths | UnevenContacts, torque: Sequence[N]) -> tuple[N, N, N]:
    """Generalised force (F_X, F_Y, M_W) of four wheel torques: the transpose of the rates."""
    if isinstance(geometry, UnevenContacts):
        return cast("tuple[N, N, N]", _transposed_product(geometry.wheel_rows, torque))
    t1, t2, t3, t4 = torque
    lever = geometry.l + geometry.h
    return (
        (t1 + t2 + t3 + t4) / geometry.R,
        (-t1 + t2 + t3 - t4) / geometry.R,
        lever * (-t1 + t2 - t3 + t4) / geometry.R,
    )


def allocate(geometry: Lengths | UnevenContacts, force: Sequence[N]) -> tuple[N, ...]:
    """Least-norm wheel torques [N m] that exert a generalised force."""
    if isinstance(geometry, UnevenContacts):
        rows = geometry.wheel_rows
        a, b, c = force
        return cast("tuple[N, ...]", _products(rows, _solved(rows, (a, b, c))))
    fx, fy, mz = force
    lever = geometry.l + geometry.h
    # The pseudo-inverse: columns are orthogonal, and four wheels share each component.
    return tuple(
        geometry.R / 4 * (fx + SIGN_LATERAL[i] * fy - SIGN_Y[i] * mz / lever) for i in range(4)
    )


def nearest_twist(geometry: Lengths | UnevenContacts, rates: Sequence[N]) -> tuple[N, N, N]:
    """The body twist whose wheel rates without slip come nearest to given ones (least squares)."""
    if isinstance(geometry, UnevenContacts):
        rows = geometry.wheel_rows
        return cast("tuple[N, N, N]", _solved(rows, _transposed_product(rows, rates)))
    fx, fy, mz = body_force(geometry, rates)
    lever, scale = geometry.l + geometry.h, geometry.R * geometry.R / 4
    return scale * fx, scale * fy, scale * mz / (lever * lever)


def roller_force(geometry: Lengths | UnevenContacts, torque: Sequence[Number]) -> Triple:
    """Generalised force (F_X, F_Y, M_W) of torques [N m] at the four rollers' axles."""
    if isinstance(geometry, UnevenContacts):
        return _transposed_product(geometry.roller_rows, torque)
    # The transpose of ``roller_rates``. F_X is 0: driving ahead turns no roller on the floor.
    f1, f2, f3, f4 = (-value / (geometry.r * COS_ROLLER) for value in torque)
    x1, x2, x3, x4 = (sign * geometry.h for sign in SIGN_X)
    return 0.0, f1 + f2 + f3 + f4, x1 * f1 + x2 * f2 + x3 * f3 + x4 * f4
