"""The derived dynamics against the paper's equations, contact constraints, and a physics engine."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from tests.youbot_env.structures import BASE_ONLY, CASES, model, random_instant
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import BODY, ROLLER, WHEEL, WORLD, Body, Effect
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.hardware import WHEELS
from youbot_env.physics.mechanism import EffectPoints, Instant
from youbot_env.simulation.free_run import initial_state
from youbot_env.simulation.lane_kernel import stepper

PLATFORM = {
    **{"m0": 31.0, "I0": 3.1, "I1": 0.009},
    **{"aX": 0.05, "aY": -0.03, "mu1": 0.2, "mu2": 0.004},
}


def platform(geometry: Geometry, **values: float) -> Model:
    merged = PLATFORM | values
    return Model(geometry, {n: Estimate(merged[n], unit) for n, unit in BASE_UNITS.items()})


OTHER = platform(Geometry(l=0.2, h=0.3, R=0.06, r=0.011, m1=1.1))
"""Not the youBot, so that no length can stand in for another."""


def test_base_wrench_is_that_of_the_papers_equations():
    at = random_instant(np.random.default_rng(0), 200)
    (vx, vy, w), (dvx, dvy, dw) = at.twist, at.acceleration
    g, p = OTHER.geometry, PLATFORM
    R, r, h, L = g.R, g.r, g.h, g.l + g.h
    m0, I0, I1, mu1, mu2 = p["m0"], p["I0"], p["I1"], p["mu1"], p["mu2"]
    m = m0 - 4 * g.m1
    max_, may = m * p["aX"], m * p["aY"]
    force_x = (m0 + 4 * I1 / R**2) * dvx - m0 * w * vy - may * dw - max_ * w**2
    force_x = force_x + 4 * mu1 / R**2 * vx
    force_y = (m0 + 4 * I1 / R**2) * dvy + m0 * w * vx + max_ * dw - may * w**2
    force_y = force_y + (4 * mu1 / R**2 + 8 * mu2 / r**2) * vy
    moment = (I0 + 4 * I1 * L**2 / R**2) * dw + max_ * (dvy + w * vx) - may * (dvx - w * vy)
    moment = moment + (4 * mu1 * L**2 / R**2 + 8 * mu2 * h**2 / r**2) * w
    expected = np.array([force_x, force_y, moment])
    derived = np.array(dynamics.wrench(np, OTHER.structure, g, OTHER.theta, at))
    np.testing.assert_allclose(derived, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_base_wrench_is_the_papers_form_for_identification():
    """y = H x with y = (L F_X, L F_Y, M_W) and vX = VX/L, vY = VY/L."""
    at = random_instant(np.random.default_rng(1), 200)
    g, p = OTHER.geometry, PLATFORM
    R, r, h, L = g.R, g.r, g.h, g.l + g.h
    m, eta = p["m0"] - 4 * g.m1, L / g.h
    x = np.array(
        [
            p["m0"] * L**2,
            p["I0"],
            4 * p["I1"] * L**2 / R**2,
            m * p["aX"] * L,
            m * p["aY"] * L,
            4 * p["mu1"] * L**2 / R**2,
            8 * p["mu2"] * h**2 / r**2,
        ]
    )
    vx, vy, w = at.twist[0] / L, at.twist[1] / L, at.twist[2]
    dvx, dvy, dw = at.acceleration[0] / L, at.acceleration[1] / L, at.acceleration[2]
    o = np.zeros_like(w)
    H = np.array(
        [
            [dvx - vy * w, o, dvx, -w * w, -dw, vx, o],
            [dvy + vx * w, o, dvy, dw, -w * w, vy, eta**2 * vy],
            [o, dw, dw, dvy + vx * w, vy * w - dvx, w, w],
        ]
    )
    expected = np.einsum("apn,p->an", H, x)
    derived = np.array(dynamics.wrench(np, OTHER.structure, g, OTHER.theta, at))
    derived *= np.array([L, L, 1.0])[:, None]
    np.testing.assert_allclose(derived, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


# --- Lagrange multipliers --------------------------------------------------------------------


def contact_constraints(m: Model, yaw: float) -> np.ndarray:
    """A (8, 11) with A q' = 0: no contact point of a roller moves on the floor.

    q = (x, y, yaw, four wheel angles, four roller angles), each wheel's contact velocity taken from
    rigid-body kinematics: centre, wheel spin about Y, and roller spin about its own axis.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    to_body = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    rows = np.zeros((8, 11))
    g = m.geometry
    unequal = [m.values.get(f"wheel_radius_error.error_{wheel}", 0.0) for wheel in WHEELS]
    more = [m.values.get(f"roller_angle_error.error_{wheel}", 0.0) for wheel in WHEELS]
    axes = np.array([-1.0, 1.0, 1.0, -1.0]) * (np.radians(45.0) + np.array(more))
    places = [(g.h, g.l), (g.h, -g.l), (-g.h, g.l), (-g.h, -g.l)]
    for i, ((x, y), d) in enumerate(zip(places, axes, strict=True)):
        rows[2 * i : 2 * i + 2, :3] = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]]) @ to_body
        rows[2 * i, 3 + i] = -g.R * (1.0 + unequal[i])
        spin = np.cross([np.cos(d), np.sin(d), 0.0], [0.0, 0.0, -g.r])
        rows[2 * i : 2 * i + 2, 7 + i] = spin[:2]
    return rows


def body_mass(m: Model, yaw: float, yaw_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """World-frame mass matrix (3, 3) of the body and its velocity-dependent force (3,)."""
    p, c, s = m.values, np.cos(yaw), np.sin(yaw)
    mass = p["m0"] - 4 * m.geometry.m1
    com = mass * np.array([c * p["aX"] - s * p["aY"], s * p["aX"] + c * p["aY"]])
    matrix = np.array([[p["m0"], 0.0, -com[1]], [0.0, p["m0"], com[0]], [-com[1], com[0], p["I0"]]])
    return matrix, np.array([*(-com * yaw_rate**2), 0.0])


def with_multipliers(m: Model, at: Instant) -> np.ndarray:
    """Acceleration (VX', VY', W') from full coordinates with Lagrange multipliers."""
    yaw, w = at.pose[2], at.twist[2]
    c, s = np.cos(yaw), np.sin(yaw)
    to_world = np.array([[c, -s], [s, c]])
    speed = np.concatenate([to_world @ at.twist[:2], [w]])
    constraints = contact_constraints(m, yaw)
    spins = -np.linalg.solve(constraints[:, 3:], constraints[:, :3] @ speed)
    rates = np.concatenate([speed, spins])
    mass, force = np.zeros((11, 11)), np.zeros(11)
    mass[:3, :3], force[:3] = body_mass(m, yaw, w)
    force = -force
    force[3:7] += at.torque
    _add_effects(m, at, rates, mass, force)
    ahead, behind = (contact_constraints(m, yaw + e) for e in (1e-6, -1e-6))
    drift = (ahead - behind) / 2e-6 * w @ rates
    kkt = np.block([[mass, -constraints.T], [constraints, np.zeros((8, 8))]])
    solved = np.linalg.solve(kkt, np.concatenate([force, -drift]))
    linear = to_world.T @ solved[:2] - w * np.array([-at.twist[1], at.twist[0]])
    return np.array([*linear, solved[2]])


def _add_effects(
    m: Model, at: Instant, rates: np.ndarray, mass: np.ndarray, force: np.ndarray
) -> None:
    """Each effect at the coordinate on which it acts; what it demands per acceleration is mass."""
    points = dynamics.effect_points(np, m.structure, m.geometry, m.theta, at)
    base = points.base
    for item, where in m.structure.wrenches:
        values = m.theta[where]
        if item.acts_at is WORLD:
            force[:3] -= np.array(item.evaluate(np, points.of(WORLD)[0], values))
        elif item.acts_at is BODY and item.name != "rigid_body":
            _add_body_effect(item, values, points, mass, force)
        for i in range(4):
            if item.acts_at is WHEEL:
                k, rest = 3 + i, (at.wheel_angle[i], at.torque[i], at.time, base)
            elif item.acts_at is ROLLER:
                k, rest = 7 + i, (at.time, base)
            else:
                break
            still, moving = (
                np.asarray(item.evaluate(np, item.acts_at.point(rates[k], a, *rest), values, i))
                for a in (0.0, 1.0)
            )
            force[k] -= still
            mass[k, k] += moving - still


def _add_body_effect(
    item: Effect, values: np.ndarray, points: EffectPoints, mass: np.ndarray, force: np.ndarray
) -> None:
    at, yaw = points.at, points.at.pose[2]
    c, s = np.cos(yaw), np.sin(yaw)
    to_world = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def demanded(acceleration: np.ndarray) -> np.ndarray:
        point = cast(Body, points.of(BODY)[0])._replace(acceleration=tuple(acceleration))
        return np.array(item.evaluate(np, point, values), dtype=float)

    still = demanded(np.zeros(3))
    per_acceleration = np.array([demanded(unit) - still for unit in np.eye(3)]).T
    turning = at.twist[2] * np.array([-at.twist[1], at.twist[0], 0.0])
    mass[:3, :3] += to_world @ per_acceleration @ to_world.T
    force[:3] -= to_world @ (still - per_acceleration @ turning)


@pytest.mark.parametrize("case", CASES)
def test_accelerations_are_those_of_full_coordinates_with_contact_constraints(case: str):
    """Eleven coordinates, eight contact constraints and Lagrange multipliers say the same.

    This proves the four-wheel kinematics, the roller factors of mu2, and that every effect's place
    is mapped to the body by the work it does.
    """
    m = model(case)
    for seed in range(10):
        at = random_instant(np.random.default_rng(seed))
        expected = with_multipliers(m, at)
        derived = dynamics.forward_dynamics(np, m.structure, m.geometry, m.theta, at)
        np.testing.assert_allclose(derived, expected, rtol=1e-9, atol=1e-9)


def test_another_platform_obeys_the_contact_constraints_too():
    at = random_instant(np.random.default_rng(0))
    derived = dynamics.forward_dynamics(np, OTHER.structure, OTHER.geometry, OTHER.theta, at)
    np.testing.assert_allclose(derived, with_multipliers(OTHER, at), rtol=1e-9, atol=1e-9)


# --- MuJoCo ----------------------------------------------------------------------------------

RIGID = platform(Geometry(), I1=0.0, mu1=0.0, mu2=0.0, aX=0.11, aY=-0.07)
"""The rigid part alone: no wheel inertia, no friction."""


@pytest.fixture(scope="module")
def engine():
    """MuJoCo's model and data of a planar body with an eccentric centre of mass.

    Its three motors push a site at O in the body's own frame, as F_X, F_Y, M_W do.
    """
    mujoco = pytest.importorskip("mujoco")
    v = RIGID.values
    share = (v["m0"] - 4 * RIGID.geometry.m1) / v["m0"]
    x, y = share * v["aX"], share * v["aY"]
    inertia = v["I0"] - v["m0"] * (x * x + y * y)
    motors = "".join(
        f'<general site="O" gear="{gear}"/>'
        for gear in ("1 0 0 0 0 0", "0 1 0 0 0 0", "0 0 0 0 0 1")
    )
    m = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option gravity="0 0 0" integrator="RK4" timestep="0.001"/><worldbody><body>
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
        <joint type="hinge" axis="0 0 1"/><site name="O"/>
        <inertial pos="{x!r} {y!r} 0" mass="{v["m0"]!r}" diaginertia="{inertia!r} {inertia!r}
        {inertia!r}"/></body></worldbody><actuator>{motors}</actuator></mujoco>""")
    return mujoco, m, mujoco.MjData(m)


def _body_twist(yaw: float, velocity: np.ndarray) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array(
        [c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0], velocity[2]]
    )


def test_rigid_accelerations_equal_mujocos(engine):
    mujoco, m, data = engine
    rng = np.random.default_rng(0)
    for _ in range(30):
        data.qpos[:], data.qvel[:] = rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3)
        data.ctrl[:] = rng.uniform(-100, 100, 3)
        mujoco.mj_forward(m, data)
        yaw, twist = data.qpos[2], _body_twist(data.qpos[2], data.qvel)
        theirs = _body_twist(yaw, data.qacc)
        theirs[:2] -= twist[2] * np.array([-twist[1], twist[0]])
        torque = RIGID.geometry.wheel_torque(data.ctrl)
        ours = RIGID.forward_dynamics(twist, torque, pose=data.qpos)
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)


def test_rigid_trajectory_equals_mujocos(engine):
    mujoco, m, data = engine
    mujoco.mj_resetData(m, data)
    force = np.array([40.0, -25.0, 12.0])
    data.ctrl[:] = force
    twist = np.array([0.5, -0.3, 0.8])
    data.qvel[:] = twist
    for _ in range(1500):
        mujoco.mj_step(m, data)
    state = initial_state(RIGID, twist=twist)[None]
    torque = RIGID.geometry.wheel_torque(force)[None]
    advance = stepper(RIGID.structure)
    advance(state, torque, RIGID.lengths, RIGID.theta[None], 1.5, 1500)
    np.testing.assert_allclose(state[0, 3:6], data.qpos, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        state[0, :3], _body_twist(data.qpos[2], data.qvel), rtol=0, atol=1e-6
    )


def test_the_oracles_can_tell(engine):
    """A centre of mass moved by a millimetre is far outside the tolerances above."""
    mujoco, m, data = engine
    moved = RIGID.with_values({"aX": RIGID.values["aX"] + 0.001})
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.0, (0.5, 0.5, 1.0), (10.0, 10.0, 10.0)
    mujoco.mj_forward(m, data)
    ours = moved.forward_dynamics(data.qvel, moved.geometry.wheel_torque(data.ctrl))
    theirs = data.qacc - np.array([-0.5, 0.5, 0.0])
    assert np.abs(ours - theirs).max() > 1e-4
    base = model(BASE_ONLY)
    at = random_instant(np.random.default_rng(0))
    other = replace(base, geometry=Geometry(r=0.0141))
    derived = dynamics.forward_dynamics(np, other.structure, other.geometry, other.theta, at)
    assert np.abs(with_multipliers(base, at) - derived).max() > 1e-4
