"""PID on the body twist: poles where promised, margins kept, limits and lost torques survived."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from controllers.interface import Controller, Loop, Observation, Reference
from controllers.linear.linear_system import (
    closed,
    effective_mass,
    sampled,
    sampled_platform,
    twist_dynamics,
)
from controllers.linear.margins import control_margins, frequency_grid, margins
from controllers.pid.design import PIDGains, PIDSettings, design, linear_pid, matrices, response
from controllers.pid.pid import PID, BodyLoops
from controllers.tuning.trials import TuningTrial, references
from controllers.tuning.tunable_laws import TunablePID
from controllers.tuning.tuning import GainSearch, Requirements
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.simulation.plant import Plant

PAPER = load_model("paper")
LAGGED = PAPER.with_effect("actuator_lag", time_constant=0.03)
LOOP = Loop(0.01, delay=0.01, measurement_delay=0.005)
SLOW = Loop(0.01, delay=0.03, measurement_delay=0.005)
STILL = Reference(np.zeros(3), np.zeros(3))


def _order(pole: complex) -> tuple[float, float]:
    return pole.real, pole.imag


def want(*twist: float) -> Reference:
    return Reference(np.array(twist), np.zeros(3))


def drive(
    control: Controller,
    wanted: Reference,
    seconds: float,
    plant: Plant,
    *,
    dead: tuple[float, float] = (0.0, 0.0),
    lost: tuple[float, float] = (0.0, 0.0),
    knows: bool = True,
) -> np.ndarray:
    """True twists (n, 3) at 100 Hz; no torque acts in ``dead``, NaN is measured in ``lost``."""
    course, applied = [], np.zeros(4)
    for k in range(round(seconds / 0.01)):
        time = 0.01 * k
        seen = np.full(3, np.nan) if lost[0] <= time < lost[1] else plant.twist
        observation = Observation(time, plant.wheel_speed, seen, None, applied if knows else None)
        torque = control(observation, wanted)
        assert np.isfinite(torque).all()
        assert np.abs(torque).max() <= 2.00812253
        applied = torque if not dead[0] <= time < dead[1] else np.zeros(4)
        plant.step(applied, 0.01)
        course.append(plant.twist)
    return np.array(course)


def test_mass_and_friction_are_the_models() -> None:
    for model in (PAPER, LAGGED):
        mass, friction = effective_mass(model)
        np.testing.assert_allclose(mass, PAPER.mass_matrix(), rtol=1e-6, atol=1e-6)
        twist = np.array([1e-4, -2e-4, 3e-4])
        np.testing.assert_allclose(
            friction @ twist, PAPER.wrench(twist, np.zeros(3)), rtol=1e-3, atol=1e-7
        )


def test_poles_are_where_promised() -> None:
    gains = PIDGains((12.0, 15.0, 18.0), 0.8)
    proportional, integral = matrices(effective_mass(PAPER), gains)
    plant = twist_dynamics(PAPER)
    top = np.hstack([plant.a - plant.b @ proportional, plant.b @ integral])
    found = np.linalg.eigvals(np.vstack([top, np.hstack([-np.eye(3), np.zeros((3, 3))])]))
    promised = [pole for b in gains.bandwidth for pole in np.roots([1, 1.6 * b, b**2]).tolist()]
    np.testing.assert_allclose(np.sort_complex(found), sorted(promised, key=_order), rtol=1e-5)


def test_fast_friction_is_left_alone() -> None:
    proportional, _ = matrices(effective_mass(PAPER), PIDGains((1.0, 1.0, 1.0)))
    mass, _ = effective_mass(PAPER)
    np.testing.assert_allclose(np.diag(np.linalg.solve(mass, proportional)), 0.0, atol=1e-9)


def test_sampled_poles_tend_to_the_continuous_ones() -> None:
    gains, period, inertia = PIDGains((10.0, 10.0, 10.0), 0.9), 1e-4, effective_mass(PAPER)
    loop = closed(sampled(twist_dynamics(PAPER), period), linear_pid(inertia, gains, period))
    np.testing.assert_allclose(np.abs(loop.poles), 10.0, rtol=0.05)


@pytest.mark.parametrize("model", [PAPER, LAGGED], ids=["base", "lag"])
def test_the_closed_form_is_the_state_spaces_response(model: Model) -> None:
    gains, frequency = design(model, SLOW), np.array([0.1, 1.0, 10.0, 100.0, 300.0])
    np.testing.assert_allclose(
        linear_pid(effective_mass(model), gains, 0.01).response(frequency),
        response(effective_mass(model), gains, 0.01, frequency),
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize(("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW)], ids=["base", "lag"])
def test_the_design_keeps_the_margins_and_wastes_none(model: Model, loop: Loop) -> None:
    pytest.importorskip("control")
    gains = design(model, loop)
    frequency = frequency_grid(0.01)
    plant = sampled_platform(model, loop)
    gain = response(effective_mass(model), gains, 0.01, frequency) @ plant.response(frequency)
    for found in (margins(gain), control_margins(gain, frequency)):
        assert found.gain.min() > 5.99
        assert found.phase.min() > 44.9
        # each axis is as fast as it may be, to the 2 % between the bandwidths that are tried
        assert (np.minimum(found.gain - 6.0, found.phase / 45.0 - 1.0) < 0.15).all()
    assert closed(plant, linear_pid(effective_mass(model), gains, 0.01)).is_stable


def test_the_derivative_earns_its_place_against_a_lag() -> None:
    motions = references(LAGGED, count=2, duration=3.0)
    run = TuningTrial(LAGGED, SLOW, motions, 3.0)
    with_it, without = (
        run.score(BodyLoops(LAGGED, SLOW, [design(LAGGED, SLOW, PIDSettings(cancels_lag=d))] * 2))
        for d in (True, False)
    )
    assert (with_it.error < 0.85 * without.error).all()
    assert design(PAPER, LOOP).derivative_time == 0.0, "nothing to cancel"


@pytest.mark.parametrize(("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW)], ids=["base", "lag"])
def test_controller_and_bank_are_the_same_law(model: Model, loop: Loop) -> None:
    run = TuningTrial(model, loop, references(model, count=1, duration=3.0), 3.0)
    gains = design(model, loop)
    bank = run.score(BodyLoops(model, loop, [gains]))
    alone = run.score_controller(lambda: PID(model, loop, gains))
    # the bank reads the motion itself half a sample back, the controller a cubic between samples
    np.testing.assert_allclose(bank.error, alone.error, rtol=1e-3)
    np.testing.assert_allclose(bank.torque_rate, alone.torque_rate, rtol=0.02)


@pytest.mark.parametrize("signs", list(itertools.product([0.8, 1.2], repeat=2)))
@pytest.mark.parametrize(("model", "loop"), [(PAPER, LOOP), (LAGGED, SLOW)], ids=["base", "lag"])
def test_stable_on_another_platform(model: Model, loop: Loop, signs: tuple[float, float]) -> None:
    """Masses and frictions off by 20 %, each way."""
    masses, frictions = signs
    factor = {"m0": masses, "I0": masses, "I1": masses, "mu1": frictions, "mu2": frictions}
    other = model.with_values({name: f * model.values[name] for name, f in factor.items()})
    controller = linear_pid(effective_mass(model), design(model, loop), 0.01)
    assert closed(sampled_platform(other, loop), controller).is_stable


def test_tuned_pid_keeps_what_is_asked() -> None:
    law = TunablePID(PAPER, LOOP)
    search = GainSearch(
        law, TuningTrial(PAPER, LOOP, references(PAPER, count=1, duration=3.0), 3.0)
    )
    best = search.best(Requirements(torque_rate=1.3))
    assert best.margins.gain.min() >= 6.0
    assert best.margins.phase.min() >= 45.0
    assert best.torque_rate <= 1.3 * (1 + 1e-9)
    assert (best.error < 0.1).all()
    point = np.array(list(best.point.values()))
    assert PID(PAPER, LOOP, law.gains(point)).gains == law.gains(point)


# --- what a loop meets -----------------------------------------------------------------------


def calm(model: Model = PAPER, **loop: float) -> PID:
    return PID(model, Loop(0.01, **loop), PIDGains((8.0, 8.0, 8.0)))


def test_it_is_a_controller_that_reaches_its_reference() -> None:
    control = calm()
    assert isinstance(control, Controller)
    assert control.preview_needed == 0
    twist = drive(control, want(0.2, -0.1, 0.3), 4.0, Plant("paper"))
    np.testing.assert_allclose(twist[-1], [0.2, -0.1, 0.3], atol=1e-3)


def test_saturation_leaves_no_windup() -> None:
    limited = calm(torque_limit=0.5)
    twist = drive(limited, want(0.2, 0.0, 0.0), 8.0, Plant("paper"))[:, 0]
    free = drive(calm(torque_limit=2.0), want(0.2, 0.0, 0.0), 8.0, Plant("paper"))[:, 0]
    assert twist[-1] == pytest.approx(0.2, rel=1e-2)
    assert twist[10] < 0.8 * free[10], "it was saturated"
    assert twist.max() < 1.01 * free.max()


def test_a_reference_out_of_reach_is_left_at_once() -> None:
    control = calm(torque_limit=0.3)
    plant = Plant("paper")
    drive(control, want(2.0, 0.0, 0.0), 20.0, plant)
    after = drive(control, STILL, 3.0, plant)[:, 0]
    assert after[50] < 0.5 * after[0]
    assert after.min() > -0.05 * after[0]
    assert abs(after[-1]) < 0.01


@pytest.mark.parametrize("knows", [True, False], ids=["torque known", "torque unknown"])
def test_seconds_without_torque_are_recovered_from(knows: bool) -> None:
    wanted = want(0.2, 0.1, 0.2)
    twist = drive(calm(), wanted, 10.0, Plant("paper"), dead=(3.0, 5.0), knows=knows)
    np.testing.assert_allclose(twist[299], wanted.twist, atol=2e-3)
    assert np.abs(twist[499]).max() < 0.02, "friction has stopped it"
    np.testing.assert_allclose(twist[-1], wanted.twist, atol=2e-3)
    overshoot = (twist[500:] / wanted.twist).max() - 1.0
    assert overshoot < (0.1 if knows else 1.0)


def test_lost_measurements_poison_nothing() -> None:
    for control in (calm(), PID(LAGGED, Loop(0.01))):
        wanted = want(0.2, 0.0, 0.0)
        twist = drive(control, wanted, 6.0, Plant("paper"), lost=(2.0, 2.3))
        np.testing.assert_allclose(twist[-1], wanted.twist, atol=5e-3)
        # the integral holds the platform meanwhile
        assert np.abs(twist[200:230, 0] - 0.2).max() < 0.03


def test_reset_starts_over_to_the_bit() -> None:
    control = calm(LAGGED, delay=0.013, measurement_delay=0.005)
    first = drive(control, want(0.1, 0.1, 0.1), 1.0, Plant("paper"))
    control.reset()
    assert np.array_equal(first, drive(control, want(0.1, 0.1, 0.1), 1.0, Plant("paper")))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PIDGains((1.0, 0.0, 1.0)), "PID bandwidth: 0.0 must be positive"),
        (lambda: PIDGains((1.0, 1.0)), "bandwidth: three numbers are needed"),  # pyright: ignore
        (lambda: PIDGains((1.0, 1.0, 1.0), -1.0), "PID damping: -1.0 must be positive"),
        (lambda: PIDGains((1.0, 1.0, 1.0), 1.0, 0.1), "a derivative needs a positive one"),
        (
            lambda: design(PAPER, LOOP, PIDSettings(gain_margin=200.0)),
            "no bandwidth of VX .* ask for less",
        ),
    ],
)
def test_a_mistake_is_one_clear_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
