"""Computed torque: the right demand at the right instant, and a feedback that nothing winds up."""

from __future__ import annotations

import timeit
import warnings
from itertools import product

import numpy as np
import pytest

from controllers.computed_torque.computed_torque import ComputedTorque
from controllers.computed_torque.feedback_design import velocity_map
from controllers.interface import Controller, Loop, Observation, Reference
from tests.controllers.driving import (
    LAGGED,
    LATE,
    ONE_SAMPLE,
    PAPER,
    Condition,
    blind,
    off,
    scaled,
    track,
)
from tests.sparing import mostly_slow
from tests.youbot_env.structures import CASES, EVERYTHING, model as structure
from youbot_env.errors import InputError
from youbot_env.model.model import BASE_UNITS, Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mechanism import Instant

CONDITIONS = {"one sample": ONE_SAMPLE, "late": LATE, "1 kHz": Condition(1000.0, 2)}


def known(condition: Condition, bandwidth: float | None = None) -> ComputedTorque:
    return ComputedTorque(condition.model, condition.loop, bandwidth)


def still(count: int = 8, *twist: float) -> Reference:
    rows = np.tile(twist or (0.0, 0.0, 0.0), (count + 1, 1))
    return Reference(rows[0], np.zeros(3), rows[1:], np.zeros((count, 3)))


# --- the feed-forward ------------------------------------------------------------------------


def smooth(time: float) -> tuple[np.ndarray, np.ndarray]:
    tones, phase = np.array([2.0, 2.6, 1.7]), np.array([0.3, 1.0, 2.0])
    size = np.array([0.3, 0.25, 0.5])
    return size * np.sin(tones * time + phase), size * tones * np.cos(tones * time + phase)


def place_at(model: Model, now: float, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Pose and wheel angles at ``time``, from ``START`` and zero at ``now``, by fine steps."""
    fine = np.linspace(now, time, 400)
    way = np.array([smooth(t)[0] for t in 0.5 * (fine[1:] + fine[:-1])]) * np.diff(fine)[:, None]
    pose = START.copy()
    for dx, dy, turn in way:
        c, s = np.cos(pose[2] + 0.5 * turn), np.sin(pose[2] + 0.5 * turn)
        pose += [c * dx - s * dy, s * dx + c * dy, turn]
    return pose, way.sum(axis=0) @ model.joint_jacobian.T


START = np.array([0.4, -0.3, 0.2])


def demanded(model: Model, now: float, time: float) -> np.ndarray:
    """Acting torques at ``time`` along ``smooth``."""
    twist, slope = (tuple(part.tolist()) for part in smooth(time))
    pose, angle = (tuple(part.tolist()) for part in place_at(model, now, time))
    at = Instant(twist, slope, pose, angle, time=time)
    found = dynamics.acting_torque(np, model.structure, model.geometry, model.theta, at)
    return np.array(found, float)


@pytest.mark.parametrize(
    "case",
    [
        *("base", EVERYTHING, "actuator_lag"),
        *(
            pytest.param(case, marks=pytest.mark.slow)
            for case in CASES
            if case not in ("base", EVERYTHING, "actuator_lag")
        ),
    ],
)
def test_without_error_it_is_the_models_inverse_dynamics_when_the_torque_acts(case: str) -> None:
    model, period, now = structure(case), 1e-4, 31.0
    control = ComputedTorque(model, Loop(period, torque_limit=50.0))
    middle = now + max(model.delay, 0.0) + 0.5 * period
    times = now + period * np.arange(control.preview_needed + 1)
    twists, slopes = (np.array(rows) for rows in zip(*map(smooth, times), strict=True))
    pose, angle = place_at(model, now, middle)
    acting = demanded(model, now, middle)
    # Steps long enough that rounding does not show in the second difference.
    before, after = (demanded(model, now, middle + step) for step in (-1e-4, 1e-4))
    wanted = model.inverse_dynamics(
        *smooth(middle),
        pose=pose,
        wheel_angle=angle,
        torque_rate=(after - before) / 2e-4,
        torque_second_rate=(after - 2 * acting + before) / 1e-8,
        time=middle,
    )
    speed = twists[0] @ np.linalg.pinv(velocity_map(model))  # as the model has it measured
    observation = Observation(now, speed, twists[0], START, acting)
    torque = control(observation, Reference(twists[0], slopes[0], twists[1:], slopes[1:]))
    np.testing.assert_allclose(torque, wanted, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("loop", "samples"),
    [(Loop(0.01), 1), (Loop(0.01, 0.03), 4), (Loop(0.01, 0.025), 4), (Loop(0.001, 0.02), 21)],
)
def test_it_asks_for_the_samples_up_to_the_end_of_its_hold(loop: Loop, samples: int) -> None:
    assert ComputedTorque(PAPER, loop).preview_needed == samples
    late = PAPER.with_effect("torque_delay", delay=0.005)
    reach = (loop.delay + 0.005) / loop.sample_time + 1
    assert ComputedTorque(late, loop).preview_needed == int(np.ceil(reach - 1e-9))


def test_a_missing_preview_is_said_once_and_guessed() -> None:
    control = known(LATE)
    with pytest.warns(UserWarning, match="shows 0 of the next 4 samples") as said:
        error = track(control, LATE, 4.0, preview=0).normalised(1.0)
    assert len(said) == 1
    assert error.max() < 0.08, "an acceleration that is held for 40 ms is that far off"


def test_accelerations_of_the_preview_are_made_up_from_its_twists() -> None:
    class Bare(ComputedTorque):
        def __call__(self, observation: Observation, reference: Reference) -> np.ndarray:
            return super().__call__(observation, reference._replace(preview_acceleration=None))

    error = track(Bare(LAGGED, LATE.loop), LATE).normalised()
    assert error.max() < 0.003


# --- tracking --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CONDITIONS)
def test_what_it_knows_it_tracks_to_a_thousandth(name: str) -> None:
    condition = CONDITIONS[name]
    seconds = 10.0 if condition.rate < 500 else 4.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runs = [track(known(condition), condition, seconds, seed=seed) for seed in (1, 2)]
    assert np.mean([run.normalised() for run in runs], axis=0).max() < 1e-3


def test_timing_is_what_makes_it_so() -> None:
    """One sample of delay that the controller does not know costs it a tenth and more."""
    naive = ComputedTorque(PAPER, Loop(0.01, 0.0, 0.0))
    knowing = known(ONE_SAMPLE)
    errors = [track(control, noise_free()).normalised().max() for control in (naive, knowing)]
    assert errors[1] < 5e-4
    assert errors[0] > 10 * errors[1]


def noise_free() -> Condition:
    return Condition(noise=0.0)


def test_noise_of_the_speeds_hardly_reaches_the_torques() -> None:
    runs = [track(known(ONE_SAMPLE), condition, 4.0) for condition in (ONE_SAMPLE, noise_free())]
    jitter, rate = (
        np.diff(part, axis=0).std() / 0.01
        for part in (runs[0].command - runs[1].command, runs[1].command)
    )
    assert jitter < 0.3 * rate


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("wheel_coulomb_friction", {"torque": 0.15}),
        ("floor_tilt", {"tilt_x": 0.02, "tilt_y": 0.01}),
    ],
)
@pytest.mark.parametrize("name", ["one sample", "late"])
def test_an_effect_in_the_model_saves_two_thirds_of_its_error(
    name: str, effect: str, values: dict[str, float]
) -> None:
    condition, hidden = CONDITIONS[name], {effect: values}
    without = track(known(condition), condition, effects=hidden)
    believed = condition.model.with_effect(effect, **values)
    with_it = track(ComputedTorque(believed, condition.loop), condition, effects=hidden)
    # A slope hardly turns the platform: yaw has nothing to gain.
    axes = [0, 1] if effect == "floor_tilt" else [0, 1, 2]
    assert (with_it.normalised()[axes] < without.normalised()[axes] / 3).all()


# --- stability -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BASE_UNITS)
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_a_parameter_that_is_off_by_a_fifth_costs_little(name: str, share: float) -> None:
    wrong = ComputedTorque(scaled(LAGGED, share, name), LATE.loop)
    assert track(wrong, LATE, 4.0).normalised().max() < 0.15


@pytest.mark.parametrize("shares", list(product([0.8, 1.2], repeat=4)))
def test_corners_of_the_parameters_are_stable(shares: tuple[float, ...]) -> None:
    wrong = LAGGED
    groups = (("m0", "aX", "aY"), ("I0",), ("I1",), ("mu1", "mu2"))
    for share, names in zip(shares, groups, strict=True):
        wrong = scaled(wrong, share, *names)
    assert track(ComputedTorque(wrong, LATE.loop), LATE, 3.0).normalised(2.0).max() < 0.3


def test_an_unknown_lag_and_delay_are_borne() -> None:
    control = ComputedTorque(PAPER, ONE_SAMPLE.loop)
    assert track(control, LATE, 5.0).normalised().max() < 0.4


# --- saturation, power, and what is not measured ----------------------------------------------


def step_up(limit: float, twist: float, seconds: float = 4.0):
    """Drive a step of VX that the torque limit makes slow; the true VX after each sample."""
    condition = Condition(noise=0.0)
    loop = Loop(0.01, 0.01, 0.005, limit)
    control = ComputedTorque(PAPER, loop)
    env = condition.environment(seconds, torque_limit=limit)
    _, info = env.reset(seed=0)
    reached = []
    for k in range(round(seconds / 0.01)):
        speed = twist if k >= 20 else 0.0
        coming = np.where(np.arange(k + 1, k + 4) >= 20, twist, 0.0)[:, None] * [1.0, 0.0, 0.0]
        wanted = Reference(np.array([speed, 0.0, 0.0]), np.zeros(3), coming, np.zeros((3, 3)))
        seen = Observation(info["time"], info["wheel_speed"], info["measured_twist"])
        _, _, _, _, info = env.step(env.to_action(control(seen, wanted)))
        reached.append(info["twist"][0])
    return np.array(reached), control


def test_saturation_leaves_no_windup() -> None:
    reached, control = step_up(limit=1.2, twist=0.4)
    rising = np.argmax(reached > 0.39)
    assert rising > 35, "the limit makes it slow"
    assert reached.max() < 1.02 * 0.4, "and it does not overshoot"
    assert abs(reached[rising + 50] - 0.4) < 0.002
    assert control.share == 1.0


def test_what_the_limit_forbids_is_not_asked_for() -> None:
    """At 0.85 N m friction holds the platform below 0.4 m/s for ever; then less is wanted."""
    reached, control = step_up(limit=0.85, twist=0.4)
    assert reached[-1] < 0.39
    assert control.share < 1.0
    seen = Observation(4.0, np.zeros(4), np.array([reached[-1], 0.0, 0.0]))
    torque = control(seen, still(4, 0.2, 0.0, 0.0))
    assert (torque < PAPER.inverse_dynamics([0.2, 0.0, 0.0], np.zeros(3)) - 0.05).all(), "brakes"


@pytest.mark.parametrize("name", ["one sample", "late"])
def test_seconds_without_power_are_forgotten_at_once(name: str) -> None:
    condition = CONDITIONS[name]
    run = track(known(condition), condition, apply=off(3.0, 5.0))
    assert run.normalised(3.5, 5.0).min() > 0.2, "it stood still"
    assert run.normalised(5.7, 10.0).max() < 0.01
    assert np.abs(run.error[500:]).max() < 1.05 * np.abs(run.error[300:500]).max(), "no overshoot"


def test_seconds_without_power_that_nobody_tells_of_end_soon() -> None:
    run = track(known(ONE_SAMPLE), apply=off(3.0, 5.0), see=blind)
    assert run.normalised(6.5, 10.0).max() < 0.02
    assert np.abs(run.error).max() < 0.8


def test_a_missing_measurement_passes() -> None:
    def lost(k: int, observation: Observation) -> Observation:
        gone = np.full(4, np.nan)
        nothing = Observation(np.nan, gone, gone[:3], gone[:3], gone)
        return nothing if k % 50 == 7 or k == 0 else observation

    run = track(known(LATE), LATE, see=lost)
    assert run.normalised().max() < 1.2e-3


def test_a_reference_that_is_not_a_number_passes() -> None:
    control = known(ONE_SAMPLE)
    seen, holes = Observation(0.0, np.zeros(4), np.zeros(3)), np.full((2, 3), np.nan)
    with pytest.warns(UserWarning, match="shows 0 of the next"):
        control(seen, Reference(np.zeros(3), np.zeros(3)))
    broken = control(seen, Reference(holes[0], holes[0], holes, holes))
    assert np.isfinite(broken).all()
    np.testing.assert_allclose(control(seen, still()), 0.0, atol=1e-12)


@pytest.mark.parametrize("pose", mostly_slow([True, False], [True]))
def test_a_slope_is_felt_where_the_platform_will_be(pose: bool) -> None:
    """Turning for 6 s, with the heading measured or reckoned from the wheels."""
    model = PAPER.with_effect("floor_tilt", tilt_x=0.04)
    control, env = ComputedTorque(model, LATE.loop), LATE.environment(6.0, model=model, lag=None)
    _, info = env.reset(seed=0)
    errors = []
    for k in range(600):
        speeds = np.minimum(0.01 * np.arange(k, k + 6), 1.0)[:, None] * [0.0, 0.0, 1.0]
        slopes = np.where(speeds < 1.0, 1.0, 0.0) * [0.0, 0.0, 1.0]
        seen = Observation(
            info["time"],
            info["wheel_speed"],
            info["measured_twist"],
            info["pose"] if pose else None,
        )
        torque = control(seen, Reference(speeds[0], slopes[0], speeds[1:], slopes[1:]))
        _, _, _, _, info = env.step(env.to_action(torque))
        errors.append(speeds[1] - info["twist"])
    assert np.abs(errors[150:]).max() < 0.003


# --- a controller among others ---------------------------------------------------------------


def test_it_is_a_controller() -> None:
    assert isinstance(known(ONE_SAMPLE), Controller)


def test_it_knows_its_model_and_what_it_sees_and_nothing_else() -> None:
    """On another platform, then on that run's observations alone: the same torques to the bit."""
    control = known(ONE_SAMPLE)
    run = track(control, effects={"payload_change": {"mass": 5.0, "time": 1.0}}, seconds=3.0)
    alone = known(ONE_SAMPLE)
    again = np.array([alone(observation, reference) for observation, reference in run.seen])
    assert np.array_equal(run.command, again)


def test_reset_starts_over_to_the_bit() -> None:
    control = known(LATE)
    first, second = (track(control, LATE, 2.0).command for _ in range(2))
    assert np.array_equal(first, second)


def test_torques_of_two_calls_do_not_share_memory() -> None:
    control = known(ONE_SAMPLE)
    seen = Observation(0.0, np.zeros(4), np.zeros(3))
    first = control(seen, still(4, 0.1, 0.0, 0.0))
    kept = first.copy()
    control(seen, still(4, -0.2, 0.0, 0.0))
    np.testing.assert_array_equal(first, kept)


def test_a_bandwidth_must_be_positive() -> None:
    with pytest.raises(InputError, match=r"bandwidth \[rad/s\]: 0.0 must be positive"):
        known(ONE_SAMPLE, bandwidth=0.0)


def test_a_step_fits_a_1_khz_loop_many_times() -> None:
    control = known(Condition(1000.0, 2))
    seen = Observation(0.0, np.ones(4), np.zeros(3), np.zeros(3), np.zeros(4))
    wanted = still(control.preview_needed, 0.1, 0.0, 0.2)
    seconds = min(timeit.repeat(lambda: control(seen, wanted), number=200, repeat=40)) / 200
    assert seconds < 50e-6, "13 us on an idle machine"
