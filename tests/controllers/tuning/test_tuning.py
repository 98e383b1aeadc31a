"""Tuning: the bank is the controller, gains keep what is asked for, and no chance plays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.interface import Loop
from controllers.kinematic import Gains, KinematicControl
from controllers.linear.linear_system import closed, sampled_platform
from controllers.tuning.trials import TuningTrial, references
from controllers.tuning.tunable_laws import (
    TunableKinematic,
    TunablePID,
    WheelLoops,
    wheel_loops,
)
from controllers.tuning.tuning import GainSearch, Requirements, tune
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")
LOOP = Loop(0.01, delay=0.01, measurement_delay=0.005)
SLOW = Loop(0.01, delay=0.03, measurement_delay=0.005)
LAGGED = PAPER.with_effect("actuator_lag", time_constant=0.03)


def trial(model=PAPER, loop: Loop = LOOP, count: int = 2, duration: float = 6.0) -> TuningTrial:
    return TuningTrial(model, loop, references(model, count=count, duration=duration), duration)


def kinematic(gains: Gains, loop: Loop = LOOP) -> KinematicControl:
    return KinematicControl(PAPER.geometry, gains, loop.torque_limit, loop.sample_time)


@pytest.mark.parametrize("gains", [Gains(), Gains(0.7, 7.0), Gains(0.6, 3.0, lead=0.023)])
@pytest.mark.parametrize("limit", [2.0, 0.3])
def test_the_bank_scores_as_the_controller_does(gains: Gains, limit: float) -> None:
    run = trial(loop=replace(LOOP, torque_limit=limit), duration=3.0)
    bank = run.score(WheelLoops([gains] * 2, PAPER.geometry, run.loop))
    alone = run.score_controller(lambda: kinematic(gains, run.loop))
    # Between samples the controller reads its preview along straight lines: what differs in the
    # last digits turns the encoders' counts at other instants.
    tolerance = 1e-9 if gains.lead == 0 else 2e-2
    np.testing.assert_allclose(bank.error, alone.error, rtol=tolerance)
    np.testing.assert_allclose(bank.torque_rate, alone.torque_rate, rtol=tolerance)
    np.testing.assert_allclose(bank.saturated, alone.saturated, atol=tolerance)
    assert (bank.saturated > 0).all() == (limit < 1)


@pytest.mark.parametrize("kind", [TunableKinematic, TunablePID])
def test_the_closed_form_is_the_state_spaces_response(kind) -> None:
    law, point = kind(LAGGED, SLOW), np.array([0.7, 1.3])
    frequency = np.array([0.1, 3.0, 50.0, 300.0])
    np.testing.assert_allclose(
        law.response(point, frequency),
        law.controller(point).response(frequency),
        rtol=1e-9,
        atol=1e-9,
    )


def test_a_candidate_does_not_depend_on_its_neighbours() -> None:
    run = trial(duration=3.0)
    law = TunableKinematic(PAPER, LOOP)
    points = np.array([[0.3, 1.0], [5.0, 200.0], [0.7, 7.0]])
    together = run.score(law.rows(points, 2))
    for row in (0, 2):
        alone = run.score(law.rows(points[row : row + 1], 2))
        np.testing.assert_array_equal(alone.error[0], together.error[row])
        assert alone.torque_rate[0] == together.torque_rate[row]
    assert together.mean_error[1] > 5 * together.mean_error[2], "it oscillates"


def test_small_signals_obey_the_linear_loop() -> None:
    """Without noise, counts or saturation the bank is the linear loop of ``wheel_loops``."""
    loop = Loop(0.01, delay=0.013, speed_noise=0.0)
    gains = Gains(0.4, 2.0)
    motions = references(LAGGED, count=1, duration=4.0, amplitude=(1e-4, 1e-4, 1e-4))
    run = TuningTrial(LAGGED, loop, motions, 4.0)
    found = run.score(WheelLoops([gains], LAGGED.geometry, loop))
    system = closed(
        sampled_platform(LAGGED, loop, (0, 0, 0)), wheel_loops(gains, LAGGED.geometry, 0.01)
    )
    reference = motions[0].twist(0.01 * np.arange(401))
    state, error = np.zeros(len(system.a)), []
    for k in range(400):
        state = system.a @ state + system.b @ reference[k]
        error.append(system.c @ state - reference[k + 1])
    share = np.sqrt(np.mean(np.square(error), axis=0) / np.mean(reference[1:] ** 2, axis=0))
    np.testing.assert_allclose(found.error[0], share, rtol=1e-3)


def test_the_plants_own_delay_counts_as_the_loops() -> None:
    late = PAPER.with_effect("torque_delay", delay=0.007)
    gains, motions = Gains(0.4, 2.0), references(PAPER, count=1, duration=3.0)
    own = TuningTrial(late, LOOP, motions, 3.0)
    looped = TuningTrial(PAPER, replace(LOOP, delay=0.017), motions, 3.0)
    scores = [run.score(WheelLoops([gains], PAPER.geometry, run.loop)) for run in (own, looped)]
    np.testing.assert_allclose(scores[0].error, scores[1].error, rtol=1e-12)


@pytest.fixture(scope="module")
def tuned():
    run = trial()
    law = TunableKinematic(PAPER, LOOP)
    return tune(law, run, Requirements(torque_rate=1.4)), GainSearch(law, run)


def test_tuned_gains_keep_what_is_asked_and_beat_the_stock_ones(tuned) -> None:
    found, search = tuned
    best = found.best
    assert best.margins.gain.min() >= 6.0
    assert best.margins.phase.min() >= 45.0
    assert best.torque_rate <= 1.4 * (1 + 1e-9)
    assert (best.poles.real < 0).all()
    stock = search.evaluate(np.array([0.12, 0.30]))
    assert (best.error < stock.error / 5).all()
    # the free best is at least as good, and pays with its margins
    assert found.free.mean_error <= best.mean_error
    assert found.free.margins.phase.min() < 45.0


def test_no_gains_of_a_fine_map_are_better(tuned) -> None:
    found, search = tuned
    kp, ki = np.meshgrid(np.geomspace(0.1, 2, 16), np.geomspace(0.5, 50, 16))
    points = np.column_stack([kp.ravel(), ki.ravel()])
    stable, gap = search.linear(points)
    score = search.score(points)
    kept = stable & (gap.gain.min(axis=1) >= 6) & (gap.phase.min(axis=1) >= 45)
    kept &= score.torque_rate <= 1.4
    assert kept.any()
    assert found.best.mean_error <= score.mean_error[kept].min() * 1.001
    assert found.free.mean_error <= score.mean_error[stable].min() * 1.02


def test_tuning_repeats_to_the_bit(tuned) -> None:
    again = GainSearch(TunableKinematic(PAPER, LOOP), trial()).best(Requirements(torque_rate=1.4))
    assert again.to_dict() == tuned[0].best.to_dict()


@pytest.mark.parametrize("factor", [0.8, 1.2])
@pytest.mark.parametrize("name", ["m0", "I0", "I1", "mu1", "mu2", "all"])
def test_tuned_gains_stay_stable_on_another_platform(tuned, name: str, factor: float) -> None:
    names = ("m0", "I0", "I1", "mu1", "mu2") if name == "all" else (name,)
    other = PAPER.with_values({n: factor * PAPER.values[n] for n in names})
    gains = Gains(**tuned[0].best.point)
    assert closed(sampled_platform(other, LOOP), wheel_loops(gains, other.geometry, 0.01)).is_stable
    run = TuningTrial(other, LOOP, references(PAPER, count=1, duration=4.0), 4.0)
    assert (run.score(WheelLoops([gains], PAPER.geometry, LOOP)).error < 0.15).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Requirements(gain_margin=-1.0), "gain_margin: -1 must be at least 0"),
        (lambda: Requirements(torque_rate=0.0), "torque_rate: 0.0 must be positive"),
        (
            lambda: trial(loop=Loop(0.01, measurement_delay=0.0034)),
            "measurement_delay: 0.0034 s is no multiple of half the sample time",
        ),
        (
            lambda: tune(TunableKinematic(PAPER, LOOP), trial(), Requirements(phase_margin=179)),
            "no gains with proportional .* keep .* phase margin >= 179 degrees; ask for less",
        ),
    ],
)
def test_a_mistake_is_one_clear_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
