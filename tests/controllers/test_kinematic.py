"""The stock control: signs, limits, no windup, and what it can and cannot follow."""

import timeit

import numpy as np
import pytest

from controllers.interface import Controller, Observation, Reference
from controllers.kinematic import Gains, KinematicControl
from youbot_env.errors import InputError
from youbot_env.motions.base import sample
from youbot_env.motions.multisine import multisine
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE

GEOMETRY = Geometry()
INERTIA, FRICTION = 0.026, 0.11
"""What one wheel of the paper's platform sees when driving forward [kg m^2, N m s]."""


def observe(wheel_speed, time: float = 0.0) -> Observation:
    speed = np.asarray(wheel_speed, float)
    return Observation(time, speed, GEOMETRY.body_twist(speed))


def want(*twist: float) -> Reference:
    return Reference(np.array(twist), np.zeros(3))


def drive(controller: KinematicControl, twists: np.ndarray, load=None) -> np.ndarray:
    """Speeds (n, 4) of four first-order wheels under the controller, from rest.

    The wheels' equation is solved exactly for a torque that is held for one sample time.
    """
    decay = np.exp(-FRICTION / INERTIA * controller.sample_time)
    load = np.zeros(len(twists)) if load is None else load
    speed, speeds = np.zeros(4), []
    for k, twist in enumerate(twists):
        torque = controller(observe(speed), Reference(twist, np.zeros(3)))
        speed = decay * speed + (1 - decay) / FRICTION * (torque - load[k])
        speeds.append(speed)
    return np.array(speeds)


def test_it_is_a_controller() -> None:
    assert isinstance(KinematicControl(), Controller)


def test_without_error_there_is_no_torque() -> None:
    control = KinematicControl()
    twist = np.array([0.2, -0.1, 0.4])
    for _ in range(100):
        torque = control(observe(GEOMETRY.wheel_speeds(twist)), want(*twist))
        np.testing.assert_allclose(torque, 0, atol=1e-13)


@pytest.mark.parametrize(
    ("twist", "signs"),
    [
        ((0.1, 0.0, 0.0), (1, 1, 1, 1)),
        ((0.0, 0.1, 0.0), (-1, 1, 1, -1)),
        ((0.0, 0.0, 0.2), (-1, 1, -1, 1)),
    ],
)
def test_torque_pushes_towards_the_reference(twist: tuple, signs: tuple) -> None:
    torque = KinematicControl()(observe(np.zeros(4)), want(*twist))
    assert (np.sign(torque) == signs).all()
    force = GEOMETRY.body_force(torque)
    assert np.argmax(np.abs(force)) == np.argmax(np.abs(twist))
    assert force @ np.array(twist) > 0


def test_first_torque_is_the_two_gains_on_the_error() -> None:
    control = KinematicControl(gains=Gains(0.12, 0.30), sample_time=0.01)
    torque = control(observe(np.zeros(4)), want(0.0475, 0.0, 0.0))
    np.testing.assert_allclose(torque, 0.12 + 0.30 * 0.01, rtol=1e-12)


def test_torque_is_limited_at_each_wheel() -> None:
    torque = KinematicControl()(observe([0.0, 0.0, 40.0, 21.0]), want(1.0, 0.0, 0.0))
    np.testing.assert_allclose(torque[:3], MAX_WHEEL_TORQUE * np.array([1, 1, -1]))
    assert abs(torque[3]) < 0.1


def test_saturation_leaves_no_windup() -> None:
    limited = KinematicControl(torque_limit=0.5, sample_time=0.01)
    for _ in range(2000):
        limited(observe(np.zeros(4)), want(0.3, 0.0, 0.0))
    # the wheels were held for 20 s; once at their speed, only what friction asks for is left
    free = limited(observe(np.full(4, 0.3 / GEOMETRY.R)), want(0.3, 0.0, 0.0))
    assert (free <= 0.5).all()
    braking = limited(observe(np.full(4, 12.0)), want(0.3, 0.0, 0.0))
    assert (braking < 0.0).all(), "it brakes at once"


def test_integral_still_unwinds_while_saturated() -> None:
    control = KinematicControl(gains=Gains(0.0, 1.0), torque_limit=1.0, sample_time=0.1)
    for _ in range(50):
        up = control(observe(np.zeros(4)), want(0.0475, 0.0, 0.0))
    np.testing.assert_allclose(up, 1.0)
    down = [control(observe(np.full(4, 2.0)), want(0.0475, 0.0, 0.0))[0] for _ in range(30)]
    assert down[0] < 1.0
    assert down[-1] == pytest.approx(-1.0)


def test_saturated_start_reaches_the_reference_without_great_overshoot() -> None:
    control = KinematicControl(torque_limit=0.9, sample_time=0.002)
    wanted = 0.35
    speeds = drive(control, np.tile([wanted, 0.0, 0.0], (5000, 1)))[:, 0] * GEOMETRY.R
    assert speeds[-1] == pytest.approx(wanted, rel=1e-3)
    assert speeds.max() < 1.05 * wanted


def test_recovers_from_a_lasting_load() -> None:
    control = KinematicControl()
    load = np.where(np.arange(8000) < 3000, 0.0, 0.3)
    speed = drive(control, np.tile([0.0, 0.0, 0.5], (8000, 1)), load)
    wanted = GEOMETRY.wheel_speeds([0.0, 0.0, 0.5])
    np.testing.assert_allclose(speed[2999], wanted, rtol=1e-3)
    assert np.abs(speed[3300] - wanted).max() > 0.2
    np.testing.assert_allclose(speed[-1], wanted, rtol=1e-3)


@pytest.mark.parametrize("lost", [np.nan, np.inf, -np.inf])
def test_a_missing_measurement_holds_the_last_torque_of_its_wheel(lost: float) -> None:
    control, other = KinematicControl(), KinematicControl()
    forward = want(0.1, 0.0, 0.0)
    first = control(observe(np.zeros(4)), forward)
    other(observe(np.zeros(4)), forward)
    speed = np.array([lost, 0.0, 0.0, 0.0])
    torque = control(observe(speed), forward)
    assert torque[0] == first[0]
    assert control.held == (True, False, False, False)
    assert (torque[1:] > first[1:]).all()  # the others' integrals go on
    after = control(observe(np.zeros(4)), forward)
    assert control.held == (False,) * 4
    assert after[0] == other(observe(np.zeros(4)), forward)[0]


def test_without_any_measurement_nothing_is_commanded() -> None:
    control = KinematicControl()
    assert not control(observe(np.full(4, np.nan)), want(0.1, 0.0, 0.0)).any()
    assert all(control.held)


def test_reset_starts_over_to_the_bit() -> None:
    control = KinematicControl()
    twists = sample(multisine(np.random.default_rng(1), duration=8.0), 0.002, 4000)
    first = drive(control, twists)
    control.reset()
    assert np.array_equal(first, drive(control, twists))


def test_torques_of_two_calls_do_not_share_memory() -> None:
    control = KinematicControl()
    first = control(observe(np.zeros(4)), want(0.1, 0.0, 0.0))
    kept = first.copy()
    control(observe(np.zeros(4)), want(-0.1, 0.0, 0.0))
    np.testing.assert_array_equal(first, kept)


def test_stock_gains_follow_slow_references_and_fail_above_half_a_radian_per_second() -> None:
    time = np.arange(0, 60, 0.01)
    errors = []
    for frequency in (0.1, 0.5, 2.0):
        reference = np.outer(np.sin(frequency * time), [0.2, 0.0, 0.0])
        error = (
            drive(KinematicControl(sample_time=0.01), reference)[:, 0] * GEOMETRY.R
            - reference[:, 0]
        )
        errors.append(error.std() / reference[:, 0].std())
    assert errors[0] < 0.06
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] > 0.3


def see(*coming: float, now: float = 0.1) -> Reference:
    """A reference of VX whose next samples are known."""
    preview = np.zeros((len(coming), 3))
    preview[:, 0] = coming
    return Reference(np.array([now, 0.0, 0.0]), np.zeros(3), preview, np.zeros_like(preview))


@pytest.mark.parametrize(
    ("lead", "needed", "read"),
    [(0.0, 0, 0.1), (0.004, 1, 0.14), (0.01, 1, 0.2), (0.025, 3, 0.35), (0.03, 3, 0.4)],
)
def test_a_lead_reads_the_reference_ahead(lead: float, needed: int, read: float) -> None:
    control = KinematicControl(gains=Gains(0.1, 0.0, lead), sample_time=0.01)
    assert control.preview_needed == needed
    torque = control(observe(np.zeros(4)), see(*[0.2, 0.3, 0.4][:needed]))
    np.testing.assert_allclose(torque, 0.1 * read / GEOMETRY.R, rtol=1e-12)


def test_a_lead_without_preview_is_refused() -> None:
    control = KinematicControl(gains=Gains(0.5, 0.0, 0.025), sample_time=0.01)
    for reference in (want(0.1, 0.0, 0.0), see(0.1, 0.2)):
        with pytest.raises(InputError, match="lead of 0.025 s needs 3 coming reference samples"):
            control(observe(np.zeros(4)), reference)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Gains(-0.1, 0.3), "gain proportional: -0.1 must be at least 0"),
        (lambda: Gains(0.1, float("inf")), "gain integral: inf is not a finite number"),
        (lambda: KinematicControl(torque_limit=0.0), "torque limit .* must be positive"),
        (lambda: KinematicControl(sample_time=-1.0), "sample time .* must be positive"),
        (lambda: Gains(lead=-0.01), "gain lead: -0.01 must be at least 0"),
    ],
)
def test_a_mistake_is_one_clear_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_a_step_fits_a_1_khz_loop_many_times() -> None:
    control, observation, reference = KinematicControl(), observe(np.ones(4)), want(0.1, 0.0, 0.2)
    seconds = min(timeit.repeat(lambda: control(observation, reference), number=500, repeat=7))
    assert seconds / 500 < 40e-6, "10 us on an idle machine"
