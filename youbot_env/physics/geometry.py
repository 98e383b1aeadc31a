"""Geometry of a four-wheel mecanum platform and its no-slip kinematics.

A wheel at (x, y) whose roller on the floor stands at the angle d to X rolls without slip at

    R phi' = VX + t VY + (t x - y) W,    t = tan(d)

(Muir, Neuman, IEEE Int. Conf. Robotics and Automation 1987). Every matrix here follows from these
rows. Four equal rollers at 45 degrees in X, the youBot's, have them written out with shared sums.

`Geometry` maps arrays; the functions below it map components (numbers, arrays of one shape,
symbols) for any object with l, h, R, r (and the tangents of the rollers, where they are not the
youBot's), so that equations of motion are traced through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, isfinite, pi, tan
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from youbot_env.errors import InputError
from youbot_env.physics.hardware import (
    MAX_BODY_SPEED,
    MAX_WHEEL_SPEED,
    MAX_WHEEL_TORQUE,
    WHEELS as WHEELS,
)
from youbot_env.physics.namespaces import N, Number, Triple

SIGN_X = (+1.0, +1.0, -1.0, -1.0)
"""x_i = SIGN_X[i] h: front wheels lie ahead of O."""

SIGN_Y = (+1.0, -1.0, +1.0, -1.0)
"""y_i = SIGN_Y[i] l: left wheels lie at positive Y."""

SIGN_LATERAL = (-1.0, +1.0, +1.0, -1.0)
"""Sign of VY in R phi_i' of rollers in X: the tangent of the roller angle d = -45, +45, +45, -45
degrees, which is that of the roller on the floor. Seen from above the rollers slant the other way.
"""

COS_ROLLER = float(np.sqrt(0.5))
"""Cosine of the 45 degree angle between a roller's axis and X."""

ARRANGEMENTS = {"X": 1.0, "O": -1.0}
"""How the rollers stand, by the figure that those of the four wheels form seen from above (those
on the floor form the other one), and the sign of their tangents over ``SIGN_LATERAL``."""

TANGENTS = tuple(f"t_{wheel}" for wheel in WHEELS)
SLANTS = tuple(f"s_{wheel}" for wheel in WHEELS)
"""Names of tan(d) and 1/cos(d) of each wheel's roller on the floor, of a `Geometry` and in codes.
"""

EQUAL_PAIRS = (1.0, 1.0, -1.0, -1.0)
"""Torques that exert no force where all rollers stand at one angle: the front wheels push against
the back ones."""

MIN_TURNING = 0.02
"""Least singular value of the wheel matrix, its arms over l + h: what of a robot in O has l within
2 % of h. Below, the yaw is not controlled."""

MIN_ROLLER_ANGLE, MAX_ROLLER_ANGLE = 0.05 * pi, 0.45 * pi
"""Between a roller's axis and X [rad]: 9 and 81 degrees; beyond, a wheel hardly drives one way."""


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
    arrangement : of the rollers, "X" or "O", as they are seen from above
    roller_angles : of each wheel, between its roller's axis and X [rad], positive
    torque_limit : largest torque of a wheel [N m]; None for the youBot's
    speed_limit : largest speed of a wheel [rad/s]; None for the youBot's

    Raises
    ------
    InputError
        If a length is not positive and finite, the mass is negative, or such wheels cannot drive
        every way.
    """

    l: float = 0.15  # noqa: E741 - the paper's name, and the model file's
    h: float = 0.2355
    R: float = 0.0475
    r: float = 0.014
    m1: float = 1.4
    arrangement: str = "X"
    roller_angles: tuple[float, float, float, float] = (pi / 4, pi / 4, pi / 4, pi / 4)
    torque_limit: float | None = None
    speed_limit: float | None = None

    def __post_init__(self) -> None:
        for name in ("l", "h", "R", "r", "m1", "torque_limit", "speed_limit"):
            value = getattr(self, name)
            if value is None and name.endswith("limit"):
                continue
            if not isinstance(value, (int, float)) or not np.isfinite(value):
                raise InputError(f"geometry {name}: {value!r} is not a finite number")
            if value < 0 or (value == 0 and name != "m1"):
                raise InputError(f"geometry {name}: {value!r} must be positive")
            # The dataclass is frozen; __post_init__ may write only this way.
            object.__setattr__(self, name, float(value))
        self._check_rollers()

    def _check_rollers(self) -> None:
        if self.arrangement not in ARRANGEMENTS:
            raise InputError(f"geometry arrangement: {self.arrangement!r} is neither 'X' nor 'O'")
        angles = tuple(self.roller_angles)
        if len(angles) != len(WHEELS) or not all(map(_is_finite, angles)):
            raise InputError(
                f"geometry roller_angles: {self.roller_angles!r} are not four finite numbers "
                f"({', '.join(WHEELS)})"
            )
        for wheel, angle in zip(WHEELS, self.roller_angles, strict=True):
            if not MIN_ROLLER_ANGLE <= angle <= MAX_ROLLER_ANGLE:
                cure = "in degrees? multiply by pi/180" if angle > pi / 2 else "it is positive"
                raise InputError(
                    f"geometry roller_angles: {angle:g} rad of wheel {wheel} is not between "
                    f"{MIN_ROLLER_ANGLE:.2f} and {MAX_ROLLER_ANGLE:.2f} ({cure})"
                )
        object.__setattr__(self, "roller_angles", tuple(map(float, self.roller_angles)))
        if self.is_plain:
            return
        columns = self._rows() / np.array([1.0, 1.0, self.l + self.h])
        sizes = np.linalg.svd(columns, compute_uv=False) if np.isfinite(columns).all() else (0.0,)
        if sizes[-1] < MIN_TURNING:
            raise InputError(
                f"geometry: rollers in {self.arrangement} with l = {self.l:g} and h = {self.h:g} m "
                "cannot turn the robot: the rollers' axes meet in its centre; which is it, X or O?"
            )

    @cached_property
    def tangents(self) -> tuple[float, float, float, float]:
        """tan(d) of the rollers on the floor; exactly 1 or -1 at 45 degrees."""
        side = ARRANGEMENTS[self.arrangement]
        of = [1.0 if _is_45(angle) else tan(angle) for angle in self.roller_angles]
        found = tuple(side * sign * t for sign, t in zip(SIGN_LATERAL, of, strict=True))
        return cast("tuple[float, float, float, float]", found)

    @cached_property
    def slants(self) -> tuple[float, float, float, float]:
        """1/cos(d) of the rollers."""
        found = tuple(1 / COS_ROLLER if _is_45(a) else 1 / cos(a) for a in self.roller_angles)
        return cast("tuple[float, float, float, float]", found)

    def __getattr__(self, name: str) -> float:
        # t_fl ... s_br: codes read single numbers by their names.
        for names, numbers in ((TANGENTS, "tangents"), (SLANTS, "slants")):
            if name in names:
                return getattr(self, numbers)[names.index(name)]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    @cached_property
    def is_plain(self) -> bool:
        """Whether all rollers stand at 45 degrees in X, as the youBot's do."""
        return self.tangents == SIGN_LATERAL

    @cached_property
    def arms(self) -> tuple[float, float, float, float]:
        """t_i x_i - y_i [m], by which a yaw rate turns each wheel; of rollers in X -L, L, -L, L."""
        places = zip(self.tangents, SIGN_X, SIGN_Y, strict=True)
        found = tuple(t * x * self.h - y * self.l for t, x, y in places)
        return cast("tuple[float, float, float, float]", found)

    @property
    def L(self) -> float:  # noqa: N802 - the paper's name
        """Lever arm of a wheel's rolling in the yaw equation [m], the mean of all if they differ.

        l + h of rollers in X, |l - h| of rollers in O.
        """
        return self.l + self.h if self.is_plain else sum(map(abs, self.arms)) / 4

    @property
    def max_wheel_torque(self) -> float:
        """Largest torque of a wheel [N m]: as given, or the youBot's."""
        return MAX_WHEEL_TORQUE if self.torque_limit is None else self.torque_limit

    @property
    def max_wheel_speed(self) -> float:
        """Largest speed of a wheel [rad/s]: as given, or the youBot's."""
        return MAX_WHEEL_SPEED if self.speed_limit is None else self.speed_limit

    @property
    def max_body_speed(self) -> float:
        """Largest speed of O [m/s]: all wheels' along X; the youBot's, where no speed is given."""
        return MAX_BODY_SPEED if self.speed_limit is None else self.R * self.speed_limit

    @property
    def bulk(self) -> float:
        """Volume of a platform of such lengths over the youBot's, if both have one shape: how many
        times heavier it may be expected to be. The cube of the wheels' distance from O."""
        return float((np.hypot(self.l, self.h) / np.hypot(Geometry.l, Geometry.h)) ** 3)

    def _rows(self) -> NDArray[np.float64]:
        """(4, 3): R times the wheel rates per body twist."""
        return np.column_stack([np.ones(4), self.tangents, self.arms])

    @property
    def wheel_jacobian(self) -> NDArray[np.float64]:
        """(4, 3): wheel rates [rad/s] per body twist (VX, VY, W); no slip."""
        # A positive (left) turn moves the left wheels back. In X the arm is l + h, not l: at 45
        # degrees the sideways motion h W of a wheel turns it as much as a forward motion does.
        return self._rows() / self.R

    @property
    def roller_jacobian(self) -> NDArray[np.float64]:
        """(4, 3): rates [rad/s] of the rollers on the floor per body twist; no slip."""
        # A roller takes up the sideways speed of its wheel, VY + x_i W; VX turns none.
        lateral = -np.array(self.slants) / self.r
        return np.column_stack([np.zeros(4), lateral, lateral * np.array(SIGN_X) * self.h])

    @property
    def least_squares(self) -> NDArray[np.float64]:
        """(4, 3): makes the nearest twist of wheel rates; its transpose the least torques of a
        force."""
        return least_squares_of(self.wheel_jacobian)

    @cached_property
    def internal(self) -> tuple[float, ...]:
        """(4,) torques that exert no force, and rates that no twist has; (1, 1, -1, -1) of equal
        rollers."""
        return no_force_of(self.wheel_jacobian)

    def wheel_speeds(self, twist: ArrayLike) -> NDArray[np.float64]:
        """Wheel rates (..., 4) [rad/s] of the body twist (..., 3) (VX, VY, W) without slip."""
        return np.asarray(twist, float) @ self.wheel_jacobian.T

    def body_twist(self, wheel_speeds: ArrayLike) -> NDArray[np.float64]:
        """Least-squares twist (..., 3) of four wheel rates (..., 4) [rad/s]."""
        return np.asarray(wheel_speeds, float) @ self.least_squares

    def slip(self, wheel_speeds: ArrayLike) -> NDArray[np.float64]:
        """phi_1' + phi_2' - phi_3' - phi_4' (...) [rad/s]: zero as long as no wheel slips.

        Of rollers at different angles the sum weighs the wheels as ``internal`` does.
        """
        return np.asarray(wheel_speeds, float) @ np.array(self.internal)

    def body_force(self, wheel_torque: ArrayLike) -> NDArray[np.float64]:
        """(F_X, F_Y, M_W) (..., 3) [N, N, N m] about O of four wheel torques (..., 4) [N m]."""
        # Equal power, M . phi' = F . V: forces use the transpose of the rates' Jacobian.
        return np.asarray(wheel_torque, float) @ self.wheel_jacobian

    def wheel_torque(self, body_force: ArrayLike) -> NDArray[np.float64]:
        """Least-norm wheel torques (..., 4) [N m] that exert the body force (..., 3)."""
        return np.asarray(body_force, float) @ self.least_squares.T


def least_squares_of(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """(J, A): makes the nearest twist of joint rates (J, A) per twist."""
    gram = jacobian.T @ jacobian
    if np.abs(gram - np.diag(np.diag(gram))).max() < 1e-12 * np.diag(gram).max():
        # Orthogonal columns: a mean with signs, without the rounding of a decomposition.
        return jacobian / (jacobian**2).sum(axis=0)
    return np.asarray(np.linalg.pinv(jacobian).T, np.float64)


def no_force_of(jacobian: NDArray[np.float64]) -> tuple[float, ...]:
    """(4,) torques that exert no force by wheel rates (4, 3) per twist; their sizes add up to 4."""
    if np.abs(np.array(EQUAL_PAIRS) @ jacobian).max() < 1e-12 * np.abs(jacobian).max():
        return EQUAL_PAIRS
    null = np.linalg.svd(jacobian.T)[2][-1]
    return tuple((null * np.sign(null[0]) * 4 / np.abs(null).sum()).tolist())


def _is_finite(value: object) -> bool:
    return isinstance(value, (int, float)) and isfinite(value)


def _is_45(angle: float) -> bool:
    """Whether an angle is 45 degrees, written with ten digits or more."""
    return abs(angle - pi / 4) < 1e-9


@dataclass(frozen=True)
class UnevenContacts:
    """The lengths of a geometry whose wheels roll each in its own way.

    tangent, slant : (4) tan(d) and 1/cos(d) of the rollers on the floor, at angles d to X
    ahead, sideways : (4) factors on what a wheel turns for the speed of its centre along X and
        along Y; roller : (4) on the rate of its roller. All are one in a nominal geometry.
    """

    l: Number  # noqa: E741 - the paper's name
    h: Number
    R: Number
    r: Number
    tangent: Sequence[Number]
    slant: Sequence[Number]
    ahead: Sequence[Number] = (1.0,) * 4
    sideways: Sequence[Number] = (1.0,) * 4
    roller: Sequence[Number] = (1.0,) * 4

    @property
    def wheel_rows(self) -> tuple[Triple, ...]:
        """Rows of the wheel Jacobian: a centre at (x, y) moves at (VX - y W, VY + x W)."""
        return tuple(self._wheel_row(i) for i in range(4))

    def _wheel_row(self, i: int) -> Triple:
        ahead, sideways = self.ahead[i], self.tangent[i] * self.sideways[i]
        x, y = SIGN_X[i] * self.h, SIGN_Y[i] * self.l
        return ahead / self.R, sideways / self.R, (sideways * x - ahead * y) / self.R

    @property
    def roller_rows(self) -> tuple[Triple, ...]:
        """The same of the rollers on the floor."""
        rates = [-1.0 * a * b / self.r for a, b in zip(self.roller, self.slant, strict=True)]
        return tuple((0.0, f, f * (SIGN_X[i] * self.h)) for i, f in enumerate(rates))


def uneven_contacts(geometry: Lengths, *factors: Sequence[Number]) -> UnevenContacts:
    """The rows of every wheel on its own, with factors ``ahead``, ``sideways`` and ``roller``."""
    tangent = tuple(getattr(geometry, name, SIGN_LATERAL[i]) for i, name in enumerate(TANGENTS))
    slant = tuple(getattr(geometry, name, 1 / COS_ROLLER) for name in SLANTS)
    lengths = geometry.l, geometry.h, geometry.R, geometry.r
    return UnevenContacts(*lengths, tangent, slant, *factors)


def _rows_of(geometry: Lengths | UnevenContacts) -> UnevenContacts | None:
    """The rows of every wheel on its own; None of rollers at 45 degrees in X."""
    if isinstance(geometry, UnevenContacts):
        return geometry
    plain = geometry.is_plain if isinstance(geometry, Geometry) else not hasattr(geometry, "t_fl")
    return None if plain else uneven_contacts(geometry)


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
    if own := _rows_of(geometry):
        return cast("tuple[N, ...]", _products(own.wheel_rows, twist))
    vx, vy, wz = twist
    lever = geometry.l + geometry.h
    return tuple(
        (vx + SIGN_LATERAL[i] * vy - SIGN_Y[i] * lever * wz) / geometry.R for i in range(4)
    )


def roller_rates(geometry: Lengths | UnevenContacts, twist: Sequence[N]) -> tuple[N, ...]:
    """No slip: rates [rad/s] of the four rollers on the floor."""
    if own := _rows_of(geometry):
        return cast("tuple[N, ...]", _products(own.roller_rows, twist))
    _, vy, wz = twist
    return tuple(-(vy + SIGN_X[i] * geometry.h * wz) / (geometry.r * COS_ROLLER) for i in range(4))


def body_force(geometry: Lengths | UnevenContacts, torque: Sequence[N]) -> tuple[N, N, N]:
    """Generalised force (F_X, F_Y, M_W) of four wheel torques: the transpose of the rates."""
    if own := _rows_of(geometry):
        return cast("tuple[N, N, N]", _transposed_product(own.wheel_rows, torque))
    t1, t2, t3, t4 = torque
    lever = geometry.l + geometry.h
    return (
        (t1 + t2 + t3 + t4) / geometry.R,
        (-t1 + t2 + t3 - t4) / geometry.R,
        lever * (-t1 + t2 - t3 + t4) / geometry.R,
    )


def allocate(geometry: Lengths | UnevenContacts, force: Sequence[N]) -> tuple[N, ...]:
    """Least-norm wheel torques [N m] that exert a generalised force."""
    if own := _rows_of(geometry):
        rows = own.wheel_rows
        a, b, c = force
        return cast("tuple[N, ...]", _products(rows, _solved(rows, (a, b, c))))
    fx, fy, mz = force
    lever = geometry.l + geometry.h
    # The pseudo-inverse: columns are orthogonal, and four wheels share each component.
    torques = tuple(
        geometry.R / 4 * (fx + SIGN_LATERAL[i] * fy - SIGN_Y[i] * mz / lever) for i in range(4)
    )
    return cast("tuple[N, ...]", torques)


def nearest_twist(geometry: Lengths | UnevenContacts, rates: Sequence[N]) -> tuple[N, N, N]:
    """The body twist whose wheel rates without slip come nearest to given ones (least squares)."""
    if own := _rows_of(geometry):
        rows = own.wheel_rows
        return cast("tuple[N, N, N]", _solved(rows, _transposed_product(rows, rates)))
    fx, fy, mz = body_force(geometry, rates)
    lever, scale = geometry.l + geometry.h, geometry.R * geometry.R / 4
    return cast("tuple[N, N, N]", (scale * fx, scale * fy, scale * mz / (lever * lever)))


def roller_force(geometry: Lengths | UnevenContacts, torque: Sequence[Number]) -> Triple:
    """Generalised force (F_X, F_Y, M_W) of torques [N m] at the four rollers' axles."""
    if own := _rows_of(geometry):
        return _transposed_product(own.roller_rows, torque)
    # The transpose of ``roller_rates``. F_X is 0: driving ahead turns no roller on the floor.
    f1, f2, f3, f4 = (-value / (geometry.r * COS_ROLLER) for value in torque)
    x1, x2, x3, x4 = (sign * geometry.h for sign in SIGN_X)
    return 0.0, f1 + f2 + f3 + f4, x1 * f1 + x2 * f2 + x3 * f3 + x4 * f4
