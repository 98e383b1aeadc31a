"""Free runs: energy, order of convergence, a tight reference, and input that cannot be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

from tests.youbot_env.structures import CASES, drive, model, random_instant
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.catalogue import GRAVITY
from youbot_env.physics.geometry import wheel_rates
from youbot_env.physics.mecanum import FULL_SPEED, MECANUM
from youbot_env.physics.mechanism import EffectPoints, Instant, component_force
from youbot_env.simulation.compiled import derivative, rollout
from youbot_env.simulation.free_run import (
    initial_state,
    ripple_rate,
    simulate,
    substeps,
)

LATE = 40.0
"""[s] When the runs begin: what begins later than a log is there by then."""


def moving(m: Model) -> np.ndarray:
    """A platform on its way somewhere."""
    return initial_state(
        m,
        twist=(0.2, -0.1, 0.3),
        pose=(0.4, -0.2, 0.5),
        wheel_angle=(1.0, 2.0, 3.0, 4.0),
        time=LATE,
    )


def delayed(m: Model, time: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """The interface's torques at the times at which they act."""
    return np.stack([np.interp(time - m.delay, time, column) for column in torque.T], axis=1)


def instants(m: Model, states: np.ndarray, torque: np.ndarray) -> Instant:
    """The motion of a free run, with the torques that act."""
    columns = states.T
    at = Instant(
        (columns[0], columns[1], columns[2]),
        pose=(columns[3], columns[4], columns[5]),
        wheel_angle=tuple(columns[6:10]),
        time=columns[10],
    )
    if m.structure.has_actuator:
        return replace(at, torque=tuple(columns[11:15]))
    late = delayed(m, columns[10], torque)
    true = dynamics.channel_torque(np, m.structure, m.geometry, m.theta, list(late.T), at)
    return replace(at, torque=true)


def power(force: tuple[np.ndarray | float, ...], at: Instant[np.ndarray]) -> np.ndarray:
    return sum((f * v for f, v in zip(force, at.twist, strict=True)), np.zeros(np.shape(at.time)))


@pytest.fixture(scope="module", params=CASES)
def run(request: pytest.FixtureRequest) -> tuple[Model, np.ndarray, Instant]:
    """A free run of two seconds in which every wheel reverses, sampled so finely that a sum over
    its samples resolves the reversal of a dry friction."""
    m = model(request.param)
    time = np.linspace(0.0, 2.0, 20001)
    torque = drive(time, 2.0)
    states = simulate(m, time, torque, moving(m))
    at = instants(m, states, torque)
    rates = np.array(wheel_rates(m.geometry, at.twist))
    assert (rates.min(axis=1) < -1).all() and (rates.max(axis=1) > 1).all()
    return m, states, at


def test_energy_balance_closes(run: tuple[Model, np.ndarray, Instant]):
    """What the wheels put in is kinetic energy or went into one of the components.

    The kinetic energy is that of the mass matrix; each component's power is its force at no
    acceleration times the twist, so that the rigid body's own (Coriolis, centrifugal) must vanish.
    """
    m, states, at = run
    matrix = dynamics.mass_matrix(
        np, m.structure, m.geometry, m.theta, Instant((0.0, 0.0, 0.0), time=LATE)
    )
    kinetic = 0.5 * np.einsum("ni,ij,nj->n", states[:, :3], matrix, states[:, :3])
    driving = power(tuple(m.joint_jacobian.T @ np.array(at.torque)), at)
    points = dynamics.effect_points(np, m.structure, m.geometry, m.theta, at)
    taken = {
        item.name: power(component_force(item, m.theta[where], points), at)
        for item, where in m.structure.wrenches
    }
    time = states[:, 10]
    work_done = simpson(np.abs(driving), x=time)
    left = kinetic[-1] - kinetic[0] - simpson(driving - sum(taken.values()), x=time)
    assert abs(left) < 1e-6 * work_done
    assert np.abs(taken["rigid_body"]).max() < 1e-12 * np.abs(driving).max()
    for item, _ in m.structure.wrenches:
        if item.dissipative:
            assert taken[item.name].min() >= -1e-12 and simpson(taken[item.name], x=time) > 0


def test_work_against_a_slope_is_the_weight_lifted():
    m = model("floor_tilt")
    time = np.linspace(0.0, 2.0, 4001)
    states = simulate(m, time, drive(time), moving(m))
    at = instants(m, states, drive(time))
    item, where = next(row for row in m.structure.slices if row[0].name == "floor_tilt")
    points = EffectPoints(np, MECANUM, m.geometry, m.theta, at, m.structure.carriers)
    work = simpson(power(component_force(item, m.theta[where], points), at), x=time)
    v, c, s = m.values, np.cos(states[:, 5]), np.sin(states[:, 5])
    share = (v["m0"] - 4 * m.geometry.m1) / v["m0"]
    x = states[:, 3] + share * (c * v["aX"] - s * v["aY"])
    y = states[:, 4] + share * (s * v["aX"] + c * v["aY"])
    slope_x, slope_y = np.sin(v["floor_tilt.tilt_x"]), np.sin(v["floor_tilt.tilt_y"])
    lifted = v["m0"] * GRAVITY * (slope_x * (x[-1] - x[0]) + slope_y * (y[-1] - y[0]))
    assert work == pytest.approx(lifted, rel=1e-9)
    assert abs(lifted) > 0.01


def test_a_payload_on_a_slope_weighs_too():
    m = model("floor_tilt").with_effect("payload_change", mass=12.0, x=0.1, y=0.05, time=0.5)
    plain = model("floor_tilt")
    at = Instant((0.0, 0.0, 0.0), time=1.0)
    before = Instant((0.0, 0.0, 0.0), time=0.0)
    still = [plain.wrench(np.zeros(3), np.zeros(3)), m.wrench(np.zeros(3), np.zeros(3), time=1.0)]
    share = (m.values["m0"] + 12.0) / m.values["m0"]
    assert still[1][:2] == pytest.approx(share * still[0][:2], rel=1e-12)
    assert dynamics.wrench(np, m.structure, m.geometry, m.theta, before)[:2] == pytest.approx(
        still[0][:2].tolist()
    )
    assert dynamics.wrench(np, m.structure, m.geometry, m.theta, at)[2] != still[0][2]


def test_no_wheel_slips_in_a_free_run(run: tuple[Model, np.ndarray, Instant]):
    m, states, at = run
    turned = states[:, 6:10] - states[0, 6:10]
    speeds = states[:, :3] @ m.joint_jacobian.T
    if not m.structure.changes_kinematics:
        assert np.abs(m.geometry.slip(turned)).max() < 1e-9
        np.testing.assert_allclose(speeds, m.geometry.wheel_speeds(states[:, :3]), atol=1e-12)
    rolled = simpson(speeds, x=states[:, 10], axis=0)
    np.testing.assert_allclose(turned[-1], rolled, rtol=0, atol=1e-7)


@pytest.mark.parametrize("case", CASES)
def test_integrator_is_of_fourth_order(case: str):
    """Halving the step divides the error by sixteen, where the model is smooth.

    The platform goes from one motion to another in which no wheel and no roller reverses.
    """
    m = model(case)
    at_rest = {"torque_rate": np.zeros(4), "time": LATE}
    torque = m.inverse_dynamics((0.7, 0.4, 0.15), np.zeros(3), **at_rest)
    start = initial_state(m, twist=(0.9, 0.3, 0.1), torque=0.8 * torque, time=LATE)

    def final(steps: int) -> np.ndarray:
        out, held = np.empty((2, len(start))), np.repeat(torque[None], 2, axis=0)
        run = rollout(m.structure, dynamics)
        run(start, held, np.array([0.4]), m.lengths, m.theta, steps, out)
        return out[1]

    # Finer, all effects together come to the kinks of the weakest ones.
    coarse = 64 if m.structure.depends_on_angle else 24
    reference = final(32 * coarse)
    errors = [np.abs(final(n * coarse) - reference).max() for n in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[0] > 1e-11, "the coarse run must be wrong enough to see the order"
    np.testing.assert_allclose(orders, 4.0, atol=0.35)


def reference_run(m: Model, time: np.ndarray, torque: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The same free run by scipy's eighth-order method, interval by interval.

    The compiled derivative is the stated one: ``tests/youbot_env/physics/test_namespaces.py``.
    """
    slopes = derivative(m.structure)
    states = [start]

    def rates(t: float, y: np.ndarray):
        now = np.array([np.interp(t - m.delay, time, column) for column in torque.T])
        return slopes(y, now, m.lengths, m.theta)

    for k in range(len(time) - 1):
        solved = solve_ivp(
            rates, time[k : k + 2], states[-1], method="DOP853", rtol=1e-10, atol=1e-12
        )
        states.append(solved.y[:, -1])
    return np.array(states)


@pytest.mark.parametrize("case", CASES)
def test_free_run_equals_a_tight_reference(case: str):
    """At 50 Hz, through reversals, with the steps that `simulate` chooses itself.

    The kink of a weak friction (of one roller, or of an absolute speed) is stepped over: that costs
    up to 5e-5 m/s, a tenth of the noise of measured twists; without one the error is below 5e-6.
    """
    m = model(case)
    time = np.linspace(0.0, 0.8, 41)
    torque = drive(time, 2.0)
    start = moving(m)
    states = simulate(m, time, torque, start)
    expected = reference_run(m, time, torque, start)
    speed = np.abs(states[:, :3] - expected[:, :3]).max()
    place = np.abs(states[:, 3:6] - expected[:, 3:6]).max()
    print(f"{case}: velocity {speed:.1e}, pose {place:.1e}")
    assert speed < 5e-5 and place < 1e-5


@pytest.mark.parametrize("delay", [0.013, 0.02, -0.017, 0.5])
def test_a_delay_moves_the_torques_and_nothing_else(delay: float):
    """As exactly as any run, for torques that are linear between samples."""
    base = model("base")
    m = base.with_effect("torque_delay", delay=delay)
    time = np.linspace(0.0, 0.8, 41)
    torque = drive(time, 2.0)
    knots = np.union1d(time, np.clip(time + m.delay, 0.0, 0.8))
    knots = knots[np.diff(knots, prepend=-1.0) > 1e-9]
    late = np.stack([np.interp(knots - m.delay, time, column) for column in torque.T], axis=1)
    expected = simulate(base, knots, late, moving(base))
    states = simulate(m, time, torque, moving(m))
    at = [int(np.abs(knots - t).argmin()) for t in time]
    np.testing.assert_allclose(states, expected[at], rtol=0, atol=5e-6)


def test_a_gap_is_stepped_as_finely_as_the_rest():
    """A log with a second missing must not be integrated in one stride there."""
    m = model("wheel_coulomb_friction")
    time = np.linspace(0.0, 2.0, 201)
    torque = np.linspace(-1.0, 1.0, 201)[:, None] * [1.0, 0.8, 0.9, 1.1]
    whole = simulate(m, time, torque, initial_state(m))
    keep = np.flatnonzero((time < 0.5) | (time > 1.5))
    gapped = simulate(m, time[keep], torque[keep], initial_state(m))
    assert gapped.shape == (len(keep), 11)
    np.testing.assert_allclose(gapped[:, :6], whole[keep, :6], rtol=0, atol=1e-5)


def test_a_single_sample_is_its_own_run():
    m = model("base")
    start = initial_state(m, twist=(0.1, 0.2, 0.3))
    np.testing.assert_array_equal(simulate(m, [0.0], np.zeros((1, 4)), start), start[None])


def test_substeps_follow_the_stiffest_mode():
    """The base model needs one step at 100 Hz; dry friction many; both within stability."""
    base, dry = model("base"), model("wheel_coulomb_friction")
    assert substeps(base, 0.01) == 1
    assert substeps(dry, 0.01) > 5
    assert substeps(dry, 0.02) == pytest.approx(2 * substeps(dry, 0.01), abs=1)
    # The rate of VX' at rest: 4 f_c / (eps R^2) over the mass, plus the viscous part.
    v, g = dry.values, dry.geometry
    slope = v["wheel_coulomb_friction.torque"] / v["wheel_coulomb_friction.smoothing"] + v["mu1"]
    surge = 4 * slope / g.R**2 / (v["m0"] + 4 * v["I1"] / g.R**2)
    assert substeps(dry, 0.01) >= 0.01 * surge / 0.25


def test_substeps_follow_a_ripple():
    """A run must not step over the waves of a force, and need not where there is none."""
    for cycles in (5.0, 20.0):
        m = model("base").with_effect("torque_ripple", amplitude=0.1, cycles=cycles)
        rate = ripple_rate(m.structure, m.geometry, m.theta)
        fastest = np.abs(m.geometry.wheel_speeds(np.array(FULL_SPEED))).max()
        assert rate == pytest.approx(cycles * fastest, rel=0.05)
        assert 0.01 * rate / substeps(m, 0.01) < 0.76
    assert substeps(m.with_effect("torque_ripple", amplitude=0.0), 0.01) == 1


def test_a_drive_without_lag_is_called_too_stiff():
    m = model("base").with_effect("actuator_lag")
    with pytest.raises(InputError, match="too stiff"):
        substeps(m, 0.01)
    with pytest.raises(InputError, match="too stiff"):
        simulate(m, [0.0, 0.01], np.zeros((2, 4)), initial_state(m))


@pytest.mark.parametrize(
    ("time", "shape", "start", "message"),
    [
        ([0.0, 0.1], (2, 3), 11, "torque must be"),
        ([0.0, 0.1], (3, 4), 11, "torque must be"),
        ([], (0, 4), 11, "torque must be"),
        ([0.0, 0.0], (2, 4), 11, "increase"),
        ([0.1, 0.0], (2, 4), 11, "increase"),
        ([0.0, np.nan], (2, 4), 11, "increase"),
        ([0.0, 0.1], (2, 4), 15, "start must hold 11"),
    ],
)
def test_what_does_not_fit_is_refused(time: list, shape: tuple, start: int, message: str):
    with pytest.raises(InputError, match=message):
        simulate(model("base"), time, np.zeros(shape), np.zeros(start))


def test_initial_state_names_what_does_not_fit():
    m = model("actuator_lag")
    assert len(initial_state(m)) == len(m.structure.state_names) == 15
    with pytest.raises(InputError, match="wheel_angle must hold 4"):
        initial_state(m, wheel_angle=(0.0, 0.0, 0.0))


def test_a_diverging_run_ends_in_numbers_that_are_not():
    m = model("base")
    torque = np.full((400, 4), 1e300)
    assert not np.isfinite(simulate(m, np.arange(400) * 0.01, torque, initial_state(m))[-1]).all()


def test_random_instants_move_every_wheel():
    """The laws are tested on motions that mean something."""
    at = random_instant(np.random.default_rng(0), 100)
    rates = np.array(wheel_rates(model("base").geometry, at.twist))
    assert (np.abs(rates).max(axis=1) > 5).all()
