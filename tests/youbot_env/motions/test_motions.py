"""Laws of the motions: exact derivatives, rest at both ends, the paper's definitions of I to IV."""

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from youbot_env.errors import InputError
from youbot_env.motions.base import Motion, MotionSequence, motion_from_dict, sample, sequence
from youbot_env.motions.calibration import (
    CALIBRATION,
    calibration,
    motion_i,
    motion_ii,
    motion_iii,
    motion_iv,
)
from youbot_env.motions.limits import MotionLimits, check_limits
from youbot_env.motions.multisine import Multisine, Tone, multisine
from youbot_env.motions.periodic import Circling, Straight, Turning
from youbot_env.motions.steps import Steps, steps
from youbot_env.physics.geometry import Geometry

GEOMETRY = Geometry()


def some_multisine(seed: int = 3, **options) -> Multisine:
    return multisine(np.random.default_rng(seed), **options)


MOTIONS: list[Motion] = [
    motion_i(),
    motion_ii(),
    motion_iii(),
    motion_iv(),
    Straight(name="line", duration=20, frequency=2, speed=0.2, direction=0.7, yaw_rate=0.9),
    some_multisine(),
    steps(np.random.default_rng(4), duration=20.0),
    calibration(),
    sequence([some_multisine(duration=9.0), motion_iii(duration=8.0)]),
]
each_motion = pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.name)


def legs_of_iv() -> list[Straight]:
    return [leg for leg in motion_iv().parts if isinstance(leg, Straight)]


def on_plateau(motion, per_period: int = 400) -> np.ndarray:
    """Times on a grid that divides the whole periods, so that means over it are integrals."""
    start, end = motion.plateau
    count = motion.periods * per_period
    return start + (end - start) * np.arange(count) / count


def numerical_derivative(motion: Motion, t: np.ndarray, h: float) -> np.ndarray:
    """Central difference of order four."""
    near, far = (motion.twist(t + d * h) - motion.twist(t - d * h) for d in (1, 2))
    return (8 * near - far) / (12 * h)


def kinks(motion) -> np.ndarray:
    """Times at which a ramp begins or ends: the twist's third derivative may jump there."""
    if isinstance(motion, MotionSequence):
        starts = [start for _, start, _ in motion.segments()]
        both = zip(motion.parts, starts, strict=True)
        return np.concatenate([start + kinks(part) for part, start in both])
    if isinstance(motion, Steps):
        starts = motion.hold * np.arange(len(motion.levels) + 1)
        return np.concatenate([starts, starts + motion.rise])
    return np.array([0.0, *motion.plateau, motion.duration])


def assert_derivative(motion: Motion, h: float = 4e-4) -> None:
    t = np.random.default_rng(0).uniform(-0.5, motion.duration + 0.5, 4000)
    smooth = np.abs(np.subtract.outer(t, kinks(motion))).min(axis=1) > 2.01 * h
    assert smooth.mean() > 0.95
    error = motion.acceleration(t[smooth]) - numerical_derivative(motion, t[smooth], h)
    assert np.abs(error).max() < 2e-9


@each_motion
def test_acceleration_is_the_derivative_of_the_twist(motion: Motion) -> None:
    assert_derivative(motion, 1e-4 if isinstance(motion, Steps) else 4e-4)


@each_motion
def test_starts_and_ends_at_rest_exactly_and_stays_there(motion: Motion) -> None:
    still = np.array([-10.0, -1e-9, 0.0, motion.duration, motion.duration + 1e-9, 1e4])
    twist, acceleration = motion.evaluate(still)
    assert not twist.any()
    assert not acceleration.any()


@each_motion
def test_twist_and_acceleration_are_continuous(motion: Motion) -> None:
    t = np.linspace(-0.1, motion.duration + 0.1, int(motion.duration * 1000))
    most = 500.0 if isinstance(motion, Steps) else 20.0  # steps are rough, and no more than that
    for values in motion.evaluate(t):
        assert np.abs(np.diff(values, axis=0)).max() < most * (t[1] - t[0])


@each_motion
def test_shapes_follow_the_times(motion: Motion) -> None:
    t = np.linspace(1.0, 2.0, 6).reshape(2, 3)
    assert motion.twist(1.0).shape == (3,)
    assert motion.twist(t).shape == motion.acceleration(t).shape == (2, 3, 3)
    np.testing.assert_allclose(motion.twist(t)[1, 2], motion.twist(2.0), rtol=0, atol=1e-14)
    table = sample(motion, 0.01, 250)
    assert table.shape == (250, 3)
    np.testing.assert_allclose(table[137], motion.twist(1.37), rtol=0, atol=1e-14)


@each_motion
def test_description_survives_json_to_the_bit(motion: Motion) -> None:
    again = motion_from_dict(json.loads(json.dumps(motion.to_dict(), allow_nan=False)))
    assert again == motion
    t = np.linspace(0, motion.duration, 997)
    assert np.array_equal(again.twist(t), motion.twist(t))


def test_mean_of_cubed_yaw_rate_is_zero_over_whole_periods_and_over_the_motion() -> None:
    for motion in (motion_i(), motion_ii(), *legs_of_iv()):
        for t in (on_plateau(motion), np.linspace(0, motion.duration, 20001)):
            yaw_rate = motion.twist(t)[:, 2]
            assert abs(np.mean(yaw_rate**3)) < 1e-12 * np.mean(np.abs(yaw_rate) ** 3) + 1e-14


def test_motion_i_turns_about_the_point_at_l_on_the_y_axis() -> None:
    motion = motion_i()
    t = np.linspace(0, motion.duration, 3001)
    twist, speeds = motion.twist(t), GEOMETRY.wheel_speeds(motion.twist(t))
    np.testing.assert_allclose(twist[:, 0], GEOMETRY.L * twist[:, 2], atol=1e-15)
    assert not twist[:, 1].any()
    np.testing.assert_allclose(speeds[:, [0, 2]], 0, atol=1e-14)
    assert np.abs(speeds).max() == pytest.approx(11.0, rel=1e-3)


def test_motion_ii_turns_about_the_point_at_l_on_the_x_axis() -> None:
    motion = motion_ii()
    t = np.linspace(0, motion.duration, 3001)
    twist, speeds = motion.twist(t), GEOMETRY.wheel_speeds(motion.twist(t))
    np.testing.assert_allclose(twist[:, 1], GEOMETRY.L * twist[:, 2], atol=1e-15)
    assert not twist[:, 0].any()
    np.testing.assert_allclose(speeds[:, [2, 3]], 0, atol=1e-14)


def test_motion_iii_translates_along_a_circle() -> None:
    motion = motion_iii()
    twist = motion.twist(on_plateau(motion))
    assert not motion.twist(np.linspace(0, motion.duration, 999))[:, 2].any()
    np.testing.assert_allclose(np.hypot(twist[:, 0], twist[:, 1]), motion.speed, rtol=1e-12)
    np.testing.assert_allclose(twist.mean(axis=0), 0, atol=1e-13)


def test_motion_iv_is_straight_and_uniform_in_the_world() -> None:
    for leg in legs_of_iv():
        dt = 1e-3
        t = np.arange(0, leg.duration + dt / 2, dt)
        twist = leg.twist(t)
        step = (twist[1:, 2] + twist[:-1, 2]) * dt / 2
        heading = np.concatenate([[0.0], np.cumsum(step)])
        turn = np.exp(1j * heading)
        world = (twist[:, 0] + 1j * twist[:, 1]) * turn
        plateau = (t > leg.ramp) & (t < leg.duration - leg.ramp)
        np.testing.assert_allclose(world[plateau], leg.speed, atol=1e-6)
        np.testing.assert_allclose(world.imag, 0, atol=1e-6)
        assert heading[-1] == pytest.approx(0, abs=1e-6)
        assert np.ptp(heading) > 0.8


def test_motion_iv_brings_the_platform_back() -> None:
    motion = motion_iv()
    _, _, half = motion.segments()[0]
    there = motion.twist(np.linspace(0, half, 5001))
    back = motion.twist(half + np.linspace(0, half, 5001))
    np.testing.assert_allclose(there[:, :2], -back[:, :2], atol=1e-12)
    np.testing.assert_allclose(there[:, 2], back[:, 2], atol=1e-12)


def test_whole_periods_fill_the_plateau() -> None:
    for motion in (motion_i(), motion_ii(), motion_iii(), *legs_of_iv()):
        start, end = motion.plateau
        assert (end - start) * motion.frequency == pytest.approx(2 * np.pi * motion.periods)
        assert 1.0 <= motion.ramp < 1.0 + np.pi / motion.frequency


def test_calibration_lasts_140_seconds_in_the_papers_order() -> None:
    motion = calibration()
    assert motion.duration == 140.0
    assert [name for name, _, _ in motion.segments()] == ["I", "III", "II", "IV"]
    np.testing.assert_array_equal(motion.twist(75.0), motion_ii().twist(5.0))


# ---- what the motions show: model.md, "Form for identification" -----------------------------

M0, I0, I1, AX, AY, MU1, MU2 = 35.3, 4.4, 6.0e-3, 0.016, -0.026, 0.11, 5.78e-3
SCALE = np.array([GEOMETRY.L, GEOMETRY.L, 1.0])
GROUPED = np.array(
    [
        M0 * GEOMETRY.L**2,
        I0,
        4 * I1 * GEOMETRY.L**2 / GEOMETRY.R**2,
        (M0 - 4 * GEOMETRY.m1) * AX * GEOMETRY.L,
        (M0 - 4 * GEOMETRY.m1) * AY * GEOMETRY.L,
        4 * MU1 * GEOMETRY.L**2 / GEOMETRY.R**2,
        8 * MU2 * GEOMETRY.h**2 / GEOMETRY.r**2,
    ]
)


def regressor(twist: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """H (n, 3, 7) of y = H x, y = (L F_X, L F_Y, M_W)."""
    vx, vy, w = (twist / SCALE).T
    ax, ay, aw = (acceleration / SCALE).T
    zero, eta2 = np.zeros_like(w), (GEOMETRY.L / GEOMETRY.h) ** 2
    rows = [
        [ax - vy * w, zero, ax, -(w**2), -aw, vx, zero],
        [ay + vx * w, zero, ay, aw, -(w**2), vy, eta2 * vy],
        [zero, aw, aw, ay + vx * w, vy * w - ax, w, w],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def gramian(motion) -> np.ndarray:
    """Mean of H^T H over the whole periods of a motion or of the parts of a sequence."""
    if not hasattr(motion, "plateau"):
        return sum((gramian(part) for part in motion.parts), np.zeros((7, 7)))
    h = regressor(*motion.evaluate(on_plateau(motion)))
    return np.einsum("nij,nik->jk", h, h) / len(h)


def unit(**entries: float) -> np.ndarray:
    direction = np.array([entries.get(f"x{i}", 0.0) for i in range(1, 8)])
    return direction / np.linalg.norm(direction)


BLIND = {
    "I": [unit(x1=1, x2=1, x5=1)],
    "II": [unit(x1=1, x2=1, x4=-1)],
    "III": [unit(x1=1, x3=-1), unit(x2=1)],
    "IV": [unit(x1=1)],
}
BLOCKS = {
    "I": [(4,), (6, 7), (1, 2, 3, 5)],
    "II": [(5,), (6, 7), (1, 2, 3, 4)],
    "III": [(1, 3), (4, 5), (6, 7)],
}


@pytest.mark.parametrize("name", CALIBRATION)
def test_rank_and_blind_directions_are_the_papers(name: str) -> None:
    matrix = gramian(CALIBRATION[name](GEOMETRY))
    values, vectors = np.linalg.eigh(matrix)
    blind = np.array(BLIND[name])
    assert values[len(blind)] > 1e-4 * values[-1]
    assert np.abs(values[: len(blind)]).max() < 1e-13 * values[-1]
    null = vectors[:, : len(blind)]
    np.testing.assert_allclose(null @ (null.T @ blind.T), blind.T, atol=1e-6)


def test_the_printed_blind_direction_of_motion_ii_is_a_misprint() -> None:
    printed, derived = unit(x1=1, x3=1, x4=-1), unit(x1=1, x2=1, x4=-1)
    matrix = gramian(motion_ii())
    assert printed @ matrix @ printed > 1e-2 * np.trace(matrix) / 7
    assert abs(derived @ matrix @ derived) < 1e-15


@pytest.mark.parametrize("name", BLOCKS)
def test_blocks_of_parameters_separate_over_whole_periods(name: str) -> None:
    matrix = gramian(CALIBRATION[name](GEOMETRY))
    for one, other in itertools.combinations(BLOCKS[name], 2):
        cross = matrix[np.ix_([i - 1 for i in one], [j - 1 for j in other])]
        assert np.abs(cross).max() < 1e-12 * np.trace(matrix)


def test_motions_i_and_ii_together_show_everything() -> None:
    for pair in (gramian(motion_i()) + gramian(motion_ii()), gramian(calibration())):
        values = np.linalg.eigvalsh(pair)
        assert values[0] > 1e-4 * values[-1]


# ---- limits ---------------------------------------------------------------------------------


def papers_body_force(twist: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    return regressor(twist, acceleration) @ GROUPED / SCALE


def test_calibration_respects_the_platforms_limits() -> None:
    peaks = check_limits(calibration(), body_force=papers_body_force)
    assert peaks.wheel_speed < 11.6
    assert peaks.body_speed < 0.3
    assert peaks.wheel_torque is not None
    assert 1.0 < peaks.wheel_torque < 2.0


def test_calibration_keeps_its_wheel_speeds_on_another_platform() -> None:
    other = Geometry(l=0.2, h=0.3, R=0.075)
    peaks = check_limits(calibration(other), other)
    assert peaks.wheel_speed == pytest.approx(check_limits(calibration()).wheel_speed, rel=0.02)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (
            MotionLimits(wheel_speed=10.0),
            r"motion 'I': speed of wheel [fb]r reaches 11 rad/s at .* s",
        ),
        (MotionLimits(body_speed=0.2), r"speed of the platform reaches 0\.261 m/s"),
        (MotionLimits(wheel_torque=1.0), r"torque of wheel .. reaches 1\.59 N m"),
    ],
)
def test_a_passed_limit_is_named(limits: MotionLimits, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_limits(motion_i(), GEOMETRY, limits, papers_body_force)


def test_peaks_are_those_of_a_fine_grid() -> None:
    motion = some_multisine()
    twist = sample(motion, 1e-3, 60_001)
    peaks = check_limits(motion)
    assert peaks.wheel_torque is None
    assert peaks.wheel_speed == pytest.approx(np.abs(GEOMETRY.wheel_speeds(twist)).max(), rel=1e-4)


# ---- multisines -----------------------------------------------------------------------------


def spectrum(motion: Multisine) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [rad/s] and amplitudes (n, 3) of the lines on the plateau."""
    start, end = motion.plateau
    count = 2048
    twist = motion.twist(start + (end - start) * np.arange(count) / count)
    lines = np.abs(np.fft.rfft(twist, axis=0)) * 2 / count
    return 2 * np.pi * np.arange(len(lines)) / (end - start), lines


def test_multisine_has_its_tones_inside_the_band_and_nothing_else() -> None:
    frequency, lines = spectrum(some_multisine(band=(0.5, 3.0), tones=7))
    present = lines > 1e-9
    assert (present.sum(axis=0) == 7).all()
    tones = frequency[present.any(axis=1)]
    assert tones.min() >= 0.5
    assert tones.max() <= 3.0
    assert present.sum(axis=1).max() == 1, "a tone belongs to one axis"
    for axis in range(3):
        own = frequency[present[:, axis]]
        assert own.min() < 1.2
        assert own.max() > 2.3


def test_multisine_repeats_as_often_as_asked_between_its_ramps() -> None:
    motion = some_multisine(tones=4, duration=64.0, periods=2)
    start, end = motion.plateau
    first = np.linspace(start, 0.5 * (start + end), 500)
    np.testing.assert_allclose(
        motion.twist(first + 0.5 * (end - start)), motion.twist(first), atol=1e-12
    )
    _, lines = spectrum(motion)
    present = np.flatnonzero((lines > 1e-9).any(axis=1))
    assert len(present) == 12
    assert (present % 2 == 0).all(), "lines of the doubled period only"


def test_multisine_is_deterministic_to_the_bit_and_seeds_differ() -> None:
    one, again, other = some_multisine(5), some_multisine(5), some_multisine(6)
    assert one == again
    assert np.array_equal(sample(one, 0.01, 6000), sample(again, 0.01, 6000))
    assert one != other


@pytest.mark.parametrize("seed", range(12))
def test_multisine_peaks_where_asked_with_a_low_crest(seed: int) -> None:
    wanted = np.array([0.22, 0.18, 0.6])
    motion = some_multisine(seed, amplitude=wanted.tolist())
    twist = sample(motion, 0.005, 12_001)
    peak = np.abs(twist).max(axis=0)
    assert (peak <= wanted).all()
    assert (peak > 0.97 * wanted).all()
    assert (peak / twist[300:-300].std(axis=0) < 2.7).all()


def test_multisine_shrinks_to_the_limits() -> None:
    limits = MotionLimits(wheel_speed=8.0, body_speed=0.5)
    large = some_multisine(amplitude=(1.0, 0.5, 2.0), limits=limits)
    peaks = check_limits(large, limits=limits)
    assert max(peaks.wheel_speed / 8.0, peaks.body_speed / 0.5) > 0.95
    ratio = np.abs(sample(large, 0.01, 6000)).max(axis=0) / [1.0, 0.5, 2.0]
    assert np.ptp(ratio) < 0.03 * ratio.mean(), "all axes shrink together"


def test_multisine_leaves_an_axis_at_rest_on_request() -> None:
    twist = sample(some_multisine(amplitude=(0.2, 0.0, 0.5)), 0.01, 6000)
    assert not twist[:, 1].any()
    assert twist[:, [0, 2]].std(axis=0).min() > 0.05


def test_short_multisine_keeps_its_tones_apart_and_inside_the_band() -> None:
    motion = some_multisine(duration=10.0, tones=8)
    tones = sorted(tone.frequency for tone in motion.tones)
    assert len(tones) == 24
    assert np.diff(tones).min() > 0.05
    assert tones[0] >= 0.5
    assert tones[-1] <= 3.0 + 1e-9


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    low=st.floats(0.1, 2.0),
    width=st.floats(0.2, 4.0),
    tones=st.integers(1, 10),
    duration=st.floats(5.0, 80.0),
    amplitude=st.tuples(*[st.just(0.0) | st.floats(1e-6, 2.0)] * 3),
)
def test_every_multisine_respects_band_limits_and_rest(
    seed: int, low: float, width: float, tones: int, duration: float, amplitude: tuple
) -> None:
    motion = some_multisine(
        seed, band=(low, low + width), tones=tones, duration=duration, amplitude=amplitude
    )
    frequencies = [tone.frequency for tone in motion.tones]
    assert len(set(frequencies)) == len(frequencies) == tones * np.count_nonzero(amplitude)
    assert all(low - 1e-6 <= w <= low + width + 1e-6 for w in frequencies)
    check_limits(motion)
    assert (np.abs(sample(motion, 0.05, 1600)).max(axis=0) <= np.array(amplitude) + 1e-12).all()
    assert not np.any(motion.evaluate([0.0, duration]))
    assert_derivative(motion)


@settings(max_examples=30, deadline=None)
@given(
    frequency=st.floats(0.3, 5.0),
    spare=st.floats(0.0, 30.0),
    number=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    kind=st.sampled_from(["turning", "circling", "straight"]),
)
def test_every_periodic_motion_obeys_the_laws(
    frequency: float, spare: float, number: tuple, kind: str
) -> None:
    a, b, c = number
    common = {"name": "m", "frequency": frequency}
    common["duration"] = 2 * np.pi / frequency + 2.0 + 1e-6 + spare
    motion = {
        "turning": lambda: Turning(**common, yaw_rate=a, lever_x=b, lever_y=c),
        "circling": lambda: Circling(**common, speed=a),
        "straight": lambda: Straight(**common, speed=a, direction=3 * b, yaw_rate=c),
    }[kind]()
    assert motion.periods >= 1
    assert_derivative(motion)
    assert not np.any(motion.evaluate([0.0, motion.duration]))
    assert motion_from_dict(motion.to_dict()) == motion
    t = np.linspace(0, motion.duration, 4001)
    assert abs(np.mean(motion.twist(t)[:, 2] ** 3)) < 1e-12


# ---- mistakes -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: motion_i(duration=4.0), "no period fits into 4 s; give it 8.28 s"),
        (lambda: motion_i(frequency=0.0), "motion 'I' frequency: 0.0 must be positive"),
        (lambda: motion_iii(wheel_speed=float("nan")), "motion 'III' wheel_speed: nan is not"),
        (lambda: motion_iv(yaw_share="half"), "motion 'IV' yaw_share: 'half' is not a finite"),  # type: ignore
        (lambda: motion_iv(legs=0), "legs: 0 is not a whole number of at least 1"),
        (lambda: calibration(order=["V"]), "'V' is none of I, II, III, IV"),
        (lambda: sequence([]), "parts must be one motion or more"),
        (lambda: some_multisine(band=(3.0, 0.5)), "band: 3 to 0.5 rad/s is empty"),
        (lambda: some_multisine(band=(0.0, 3.0)), "band: 0.0 must be positive"),
        (lambda: some_multisine(duration=3.0), "must be longer than two ramps"),
        (lambda: some_multisine(amplitude=(1.0, 2.0)), "three numbers"),
        (lambda: some_multisine(amplitude=(1.0, -2.0, 0.1)), "three numbers of at least 0"),
        (lambda: some_multisine(tones=0), "tones: 0 is not a whole number of at least 1"),
        (lambda: some_multisine(draws=2.5), "draws: 2.5 is not a whole number"),
        (
            lambda: Multisine(name="m", duration=9, ramp=1, tones=(Tone(3, 1.0, 1.0, 0.0),)),
            "axis: 3 is none of 0",
        ),
        (lambda: Multisine(name="m", duration=9, ramp=5, tones=()), "two ramps are longer"),
        (lambda: sample(motion_i(), 0.0, 5), "dt: 0.0 must be positive"),
        (lambda: MotionLimits(wheel_speed=-1.0), "limit wheel_speed: -1.0 must be positive"),
        (lambda: motion_from_dict([1]), "is not an object with a 'kind'"),  # type: ignore
        (lambda: motion_from_dict({"kind": "dance"}), "'dance' is none of circling, multisine"),
        (lambda: motion_from_dict({"kind": "circling"}), "field 'duration' is missing"),
        (
            lambda: motion_from_dict({**motion_iii().to_dict(), "sped": 1}),
            "field 'sped' is unknown, use duration",
        ),
        (
            lambda: motion_from_dict({**motion_iii().to_dict(), "speed": "fast"}),
            "motion 'III' speed: 'fast' is not a finite number",
        ),
        (
            lambda: motion_from_dict({**motion_iii().to_dict(), "speed": 10**400}),
            "is not a finite number",
        ),
        (
            lambda: motion_from_dict({"kind": "sequence", "name": "s", "parts": 3}),
            "a list of motions is needed",
        ),
        (
            lambda: motion_from_dict(
                {"kind": "multisine", "name": "m", "duration": 9, "ramp": 1, "tones": [{"a": 1}]}
            ),
            "a list of objects with axis, frequency, amplitude, phase",
        ),
    ],
)
def test_a_mistake_is_one_clear_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_steps_hold_their_levels_and_refuse_what_cannot_be() -> None:
    motion = Steps(name="s", rise=0.2, hold=1.0, levels=((0.3, 0.0, 0.1), (-0.3, 0.0, -0.1)))
    assert motion.duration == pytest.approx(2.2)
    assert motion.twist([0.5, 1.5]).tolist() == [[0.3, 0.0, 0.1], [-0.3, 0.0, -0.1]]
    drawn = steps(np.random.default_rng(1), amplitude=(2.0, 2.0, 5.0))
    assert MotionLimits().room(drawn.twist(np.linspace(0, 60, 6000)), GEOMETRY) > 0.999
    with pytest.raises(InputError, match="rise"):
        Steps(name="s", rise=2.0, hold=1.0, levels=((0.3, 0.0, 0.1),))
    with pytest.raises(InputError, match="three numbers"):
        Steps(name="s", rise=0.1, hold=1.0, levels=((0.3, 0.0),))  # pyright: ignore
    with pytest.raises(InputError, match="at least one"):
        Steps(name="s", rise=0.1, hold=1.0, levels=())


def test_every_kind_can_be_read_whatever_is_imported_first():
    code = (
        "from youbot_env.motions.base import motion_from_dict;"
        f"print(motion_from_dict({some_multisine().to_dict()!r}).kind)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (run.stdout, run.stderr) == ("multisine\n", "")


@pytest.mark.parametrize("duration", (1e308, 1e12, 86401.0))
def test_a_motion_lasts_a_day_at_most(duration: float):
    """Its samples must fit into memory."""
    with pytest.raises(InputError, match="is longer than a day"):
        multisine(np.random.default_rng(0), duration=duration)
    with pytest.raises(InputError, match="is longer than a day"):
        motion_from_dict(motion_iii().to_dict() | {"duration": duration})
