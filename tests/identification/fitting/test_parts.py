"""Long logs are fitted in parts: the same rows, to rounding, in bounded memory."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from controllers.recording import record
from identification.fitting.errors import NoiseLevel, Traces, force_traces, velocity_traces
from identification.fitting.harmonic_scan import harmonic_scan
from identification.fitting.kinematic_evidence import KinematicEvidence
from identification.fitting.output_error import _FreeRuns
from identification.fitting.predictability import predictability, velocity_floor
from identification.fitting.regression import filtered_residual, regression
from identification.fitting.settings import FitSettings
from identification.logs.reading import write_log
from identification.mechanisms.mechanism import Mechanism, pass_over
from identification.mechanisms.registry import mechanism_of
from identification.mechanisms.samples import Samples, averaged_down, cut
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.table import residual_table
from tests.identification.healthy import healthy_log
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine

Array = NDArray[np.float64]

WHOLE = FitSettings()
PARTS = replace(WHOLE, max_part_samples=500)

ZERO = np.zeros(4)

EFFECTS = (
    (),
    ("torque_delay",),
    ("friction_warmup", "torque_ripple"),
    ("load_dependent_friction",),
    ("actuator_lag",),
    ("floor_tilt", "torque_saturation"),
    ("wheel_radius_error",),
)


@pytest.fixture(scope="module")
def samples() -> Samples:
    mechanism = mechanism_of(load_model("paper"))
    return mechanism.samples(healthy_log(rate=100.0, duration=60.0, extras=True))


@pytest.mark.parametrize("effects", EFFECTS, ids="+".join)
def test_rows_in_parts_are_those_of_the_whole_to_rounding(samples: Samples, effects):
    model = load_model("paper")
    for name in effects:
        model = model.with_effect(name)
    mechanism = mechanism_of(model)
    free = np.flatnonzero(mechanism.free)
    theta = model.theta + 0.01 * mechanism.scale
    whole = regression(mechanism, theta, samples, free, WHOLE)
    parts = regression(mechanism, theta, samples, free, PARTS)
    assert (parts.time == whole.time).all() and parts.step == whole.step
    scale = np.abs(whole.residual).max()
    np.testing.assert_allclose(parts.residual, whole.residual, atol=1e-11 * scale)
    for k in range(len(free)):
        size = np.abs(whole.columns[..., k]).max()
        np.testing.assert_allclose(
            parts.columns[..., k], whole.columns[..., k], atol=1e-9 * max(size, 1e-12)
        )
    alone = filtered_residual(mechanism, theta, samples, PARTS)
    np.testing.assert_allclose(alone, whole.residual, atol=1e-11 * scale)


def test_rows_at_rest_are_zero_in_parts_too(samples: Samples):
    mechanism = mechanism_of(load_model("paper"))
    moves = np.ones(len(samples), bool)
    moves[1000:1700] = False
    resting = replace(samples, moves=moves)
    theta, free = load_model("paper").theta, np.flatnonzero(mechanism.free)
    found = [regression(mechanism, theta, resting, free, of).residual for of in (WHOLE, PARTS)]
    assert ((found[0] == 0) == (found[1] == 0)).all() and (found[0] == 0).any()
    np.testing.assert_allclose(found[1], found[0], atol=1e-11 * np.abs(found[0]).max())


def test_a_smoothed_channel_is_computed_once(samples: Samples):
    assert samples.smoothed("torque", 5.0) is samples.smoothed("torque", 5.0)
    assert samples.smoothed("torque", 6.0) is not samples.smoothed("torque", 5.0)
    changed = replace(samples, torque=2.0 * samples.torque)
    np.testing.assert_allclose(
        changed.smoothed("torque", 5.0), 2.0 * samples.smoothed("torque", 5.0)
    )


def test_what_may_predict_a_residual_is_the_same_in_parts(samples: Samples):
    mechanism = mechanism_of(load_model("paper"))
    theta, free = load_model("paper").theta, np.flatnonzero(mechanism.free)
    rows = [regression(mechanism, theta, samples, free, WHOLE)]
    whole, parts = (predictability(mechanism, rows, [samples], 0, of) for of in (WHOLE, PARTS))
    assert parts.share == pytest.approx(whole.share, abs=1e-3)


def test_force_traces_are_the_same_in_parts(samples: Samples):
    mechanism = mechanism_of(load_model("paper").with_effect("torque_delay"))
    theta = mechanism.extend_theta(load_model("paper").theta, "torque_delay", {})
    theta[-1] = 0.03
    whole, parts = (force_traces(mechanism, theta, samples, of) for of in (WHOLE, PARTS))
    assert (parts.time == whole.time).all()
    size = np.abs(whole.measured).max()
    np.testing.assert_allclose(parts.measured, whole.measured, atol=1e-11 * size)
    np.testing.assert_allclose(parts.predicted, whole.predicted, atol=1e-9 * size)


@pytest.mark.parametrize("effects", [(), ("torque_ripple",), ("torque_delay",)], ids="+".join)
def test_a_free_run_goes_on_where_its_last_piece_ended(samples: Samples, effects):
    model = load_model("paper")
    for name in effects:
        model = model.with_effect(name)
    whole = mechanism_of(model)
    pieces = mechanism_of(model, settings=replace(whole.settings, max_run_samples=700))
    runs = [one.free_run(model.theta, samples) for one in (whole, pieces)]
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-9)


@pytest.mark.parametrize("effects", [(), ("wheel_radius_error",)], ids="+".join)
def test_a_map_is_the_same_in_parts(samples: Samples, effects):
    model = load_model("paper")
    for name in effects:
        model = model.with_effect(name)
    mechanism, chosen = mechanism_of(model), ResidualMapSettings()
    whole, parts = (
        residual_table(mechanism, model.theta, [samples], settings, WHOLE)
        for settings in (chosen, replace(chosen, max_part_samples=700))
    )
    for one, other in zip(whole.folds, parts.folds, strict=True):
        for name in ("features", "columns", "residual"):
            a, b = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(b, a, atol=1e-9 * np.abs(a).max())


def test_the_floor_of_a_free_run_is_the_same_in_pieces(samples: Samples):
    model = load_model("paper")
    mechanism = mechanism_of(model)
    pieces = mechanism_of(model, settings=replace(mechanism.settings, max_run_samples=700))
    clean = velocity_traces(mechanism, model.theta, samples)
    level, torque = NoiseLevel(np.full(4, 0.02), ZERO), samples.torque.__getitem__
    whole, parts = (
        velocity_floor(one, model.theta, samples, torque, clean, level, 3).residual
        for one in (mechanism, pieces)
    )
    assert parts == pytest.approx(whole, rel=1e-9) and (whole > 0).all()


def test_samples_that_nobody_needs_are_gone_at_once(samples: Samples):
    short = replace(samples)
    watched = weakref.ref(short)
    assert short.for_fit is short
    del short
    assert watched() is None


def test_averaged_samples_rest_where_some_of_a_block_rests(samples: Samples):
    moves = np.ones(len(samples), bool)
    moves[12] = False
    slow = averaged_down(replace(samples, moves=moves), 20.0)
    assert slow.dt == pytest.approx(5 * samples.dt) and len(slow) == len(samples) // 5
    assert slow.moves is not None and slow.moves.dtype == bool
    assert np.flatnonzero(~slow.moves).tolist() == [2]
    np.testing.assert_allclose(slow.twist[2], samples.twist[10:15].mean(axis=0))
    assert averaged_down(samples, 60.0) is samples


def test_wheels_say_the_same_of_a_log_that_is_averaged_down():
    model = load_model("paper").with_effect("wheel_radius_error")
    plain = mechanism_of(load_model("paper"))
    log = plain.samples(healthy_log(rate=1000.0, duration=30.0, extras=True))
    speed = log.wheel_speed * (1.0, 1.0, 1.01, 1.0)
    odd = replace(log, wheel_speed=speed, twist=speed @ plain.least_squares)
    fast = replace(WHOLE, kinematics=replace(WHOLE.kinematics, max_sample_rate=2000.0))
    found = []
    for settings in (WHOLE, fast):
        evidence = KinematicEvidence(plain, load_model("paper").theta, [odd], settings)
        fit = evidence.fitted(mechanism_of(model), model.theta, ["wheel_radius_error"])
        found.append((fit.theta[fit.own], fit.longest_sample, len(evidence.logs[0])))
    (slow, dt, few), (exact, same, many) = found
    assert (dt, few) == (same, many // 5)
    assert np.ptp(exact) == pytest.approx(0.01, abs=2e-3)
    np.testing.assert_allclose(slow, exact, atol=1e-4)


@pytest.mark.parametrize("effect", ["wheel_coulomb_friction", "torque_ripple"])
def test_noise_that_is_put_on_parts_is_that_of_the_whole(samples: Samples, effect):
    model = load_model("paper").with_effect(effect)
    mechanism, free = mechanism_of(model), np.array([0, 3])
    samples = replace(samples, angle_measured=False)
    speed = np.full(4, 0.1)
    noisy = mechanism.noisy(samples, speed, 0.0 * speed, np.random.default_rng(7))
    added = mechanism.speed_noise(samples, speed, np.random.default_rng(7))
    whole = regression(mechanism, model.theta, noisy, free, WHOLE)
    parts = regression(mechanism, model.theta, samples, free, PARTS, added)
    size = np.abs(whole.residual).max()
    np.testing.assert_allclose(parts.residual, whole.residual, atol=1e-10 * size)
    np.testing.assert_allclose(
        parts.columns, whole.columns, atol=1e-9 * np.abs(whole.columns).max()
    )


def test_numbers_that_are_passed_over_leave_the_next_ones_what_they_are():
    one, other = np.random.default_rng(3), np.random.default_rng(3)
    one.standard_normal(2_500_001)
    pass_over(other, 2_500_001)
    assert (one.standard_normal(5) == other.standard_normal(5)).all()


GROWTH = 350
"""Bytes a row: an hour at 1 kHz, 3.6 million rows, is to fit into 1.5 GB with all the rest."""


def _scan(mechanism: Mechanism, theta: Array, part: Samples, settings: FitSettings) -> None:
    rows = filtered_residual(mechanism, theta, part, settings)
    assert harmonic_scan(mechanism, [rows], [part], settings)


def _wheels_and_pose(
    mechanism: Mechanism, theta: Array, part: Samples, settings: FitSettings
) -> None:
    evidence = KinematicEvidence(mechanism, theta, [part], settings)
    more = mechanism.extended("wheel_creep")
    assert len(evidence.at(more, mechanism.extend_theta(theta, "wheel_creep", {})).rows) == 1


def _free_run(mechanism: Mechanism, theta: Array, part: Samples, settings: FitSettings) -> None:
    run = _FreeRuns(mechanism, [part], settings, lambda: None)
    assert np.isfinite(run.residuals(theta)[0]).all()


def _table(mechanism: Mechanism, theta: Array, part: Samples, settings: FitSettings) -> None:
    chosen = ResidualMapSettings(max_sample_rate=50.0, max_part_samples=400, max_rows=400)
    table = residual_table(mechanism, theta, [part], chosen, settings)
    assert all(np.isfinite(fold.features).all() for fold in table.folds)


def _floor_of_velocity(
    mechanism: Mechanism, theta: Array, part: Samples, settings: FitSettings
) -> None:
    quiet, level = Traces(part.time, part.twist, part.twist), NoiseLevel(np.full(4, 0.01), ZERO)
    torque = part.torque.__getitem__
    assert velocity_floor(mechanism, theta, part, torque, quiet, level, 0).residual.all()


@pytest.mark.parametrize("work", [_scan, _wheels_and_pose, _free_run, _table, _floor_of_velocity])
def test_what_is_found_out_of_a_longer_log_takes_little_more_memory(
    work: Callable[..., None], monkeypatch: pytest.MonkeyPatch
):
    # Of two threads it is chance which parts are there at the same time.
    monkeypatch.setenv("YOUBOT_THREADS", "1")
    mechanism, theta = mechanism_of(load_model("paper")), load_model("paper").theta
    mechanism = replace(mechanism, settings=replace(mechanism.settings, max_run_samples=2000))
    few = replace(WHOLE.harmonic_scan, max_waves=4, max_wheel_order=2, exact_waves=1)
    # Averaged down to a fifth, as 1 kHz is.
    known = replace(WHOLE.kinematics, max_samples_at_once=4000, max_sample_rate=100.0)
    settings = replace(WHOLE, max_part_samples=4000, harmonic_scan=few, kinematics=known)
    log = mechanism.samples(healthy_log(rate=500.0, duration=100.0, extras=True))

    def peak(count: int) -> int:
        part = cut(log, 0, count)
        tracemalloc.start()
        try:
            work(mechanism, theta, part, settings)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    short, long = 25_000, 50_000
    peak(short)  # what is imported and compiled at first
    # Beside the log itself, which has 250.
    assert (peak(long) - peak(short)) / (long - short) < 100


@pytest.fixture(scope="module")
def periodic(tmp_path_factory: pytest.TempPathFactory) -> Callable[[float, bool], Path]:
    """A file with some seconds at 1 kHz of a motion that repeats, with a pose or without one."""
    folder = tmp_path_factory.mktemp("long")

    def written(duration: float, with_pose: bool) -> Path:
        motion = multisine(np.random.default_rng(3), duration=60.0)
        motion = replace(motion, name="long", duration=duration)
        log = record(load_model("paper"), [motion], rate=1000.0, seed=1)[0]
        path = folder / f"long_{duration:g}_{with_pose}.csv"
        write_log(path, log if with_pose else replace(log, pose=None))
        return path

    return written


@pytest.mark.slow
@pytest.mark.parametrize("with_pose", [False, True])
@pytest.mark.parametrize("command", ["doctor", "identify", "compare"])
def test_memory_of_a_long_log_grows_by_little_more_than_its_samples(
    periodic: Callable[[float, bool], Path], command: str, with_pose: bool
):
    """The commands on files whose noise is all that a model misses: then all is looked for."""
    code = "import resource, sys; from youbot_scripts import cli; cli.main(sys.argv[1:]); "
    code += "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, file=sys.stderr)"
    model = ["paper"] if command == "compare" else []

    def peak(duration: float) -> int:
        path = str(periodic(duration, with_pose))
        call = [sys.executable, "-c", code, command, *model, path]
        run = subprocess.run(call, capture_output=True, text=True, check=True)
        return int(run.stderr.split()[-1])

    short, long = 300.0, 600.0
    assert (peak(long) - peak(short)) / (1000.0 * (long - short)) < GROWTH
