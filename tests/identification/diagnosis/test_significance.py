from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.diagnosis.candidates import (
    _evidence,
    _Noise,
    fit_base,
    try_candidate,
)
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.significance import (
    Evidence,
    candidate_p_values,
    score_blocks,
)
from identification.diagnosis.structures import LoggedData
from identification.fitting.cross_validation import cross_validate, make_folds
from identification.fitting.regression import Regression
from identification.fitting.span import Span, stacked
from identification.mechanisms.registry import mechanism_of
from identification.residual_map.bootstrap import random_signs
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model

PAPER = load_model("paper")


def rows(rng, count=2000, size=3):
    columns = rng.standard_normal((count, 3, size))
    time = 0.05 * np.arange(1.0, count + 1)
    return Regression(time, 0.05, rng.standard_normal((count, 3)), columns)


def test_held_out_equals_fitting_without_each_log():
    rng = np.random.default_rng(0)
    logs = [rows(rng, 200), rows(rng, 150), rows(rng, 250)]
    folds = make_folds(logs)
    basis = np.eye(3)
    found = cross_validate([r.residual for r in logs], [r.columns for r in logs], folds, basis)
    for k, fold in enumerate(folds):
        rest = [row for j, row in enumerate(logs) if j != k]
        matrix = np.concatenate([row.columns.reshape(-1, 3) for row in rest])
        right = np.concatenate([row.residual.ravel() for row in rest])
        step = np.linalg.lstsq(matrix, right, rcond=None)[0]
        np.testing.assert_allclose(found.steps[k], step, atol=1e-10)
        np.testing.assert_allclose(
            found.residual[k], logs[fold.log].residual - logs[fold.log].columns @ step, atol=1e-10
        )


def test_one_log_is_held_out_in_five_blocks():
    log = rows(np.random.default_rng(1), 503)
    folds = make_folds([log])
    assert len(folds) == 5
    covered = np.concatenate([np.arange(503)[fold.rows] for fold in folds])
    np.testing.assert_array_equal(covered, np.arange(503))


def test_a_log_that_alone_shows_a_combination_of_columns_is_held_out_in_blocks():
    """A fading strength is a column of its own in the first log, and any strength in the others."""
    rng = np.random.default_rng(2)
    logs = [rows(rng, 400) for _ in range(3)]
    fading = np.exp(-logs[0].time / 5.0)[:, None]
    faded = [logs[0].columns[..., 0] * (1 - fading), *(log.columns[..., 0] for log in logs[1:])]
    columns = [
        np.concatenate([log.columns, own[..., None], 0.0 * own[..., None]], axis=-1)
        for log, own in zip(logs, faded, strict=True)
    ]
    assert [fold.log for fold in make_folds(logs, columns)] == [0] * 5 + [1, 2]
    assert all(fold.whole for fold in make_folds(logs, [part[..., :3] for part in columns]))


def test_noise_of_the_speeds_that_lasts_is_taken_off_the_evidence_of_a_drive():
    """It is in the column and in the residual; as white it would be a small part of itself."""
    rng, log = np.random.default_rng(4), recording(noise=0.0)
    slow = 0.02 * np.sqrt(1 - 0.8**2) * coloured_columns(rng.standard_normal((len(log), 4)), 0.8)
    torque = log.effort + 0.03 * rng.standard_normal((len(log), 4))
    mechanism = mechanism_of(PAPER)
    data = LoggedData(mechanism, [replace(log, velocity=log.velocity + slow, effort=torque)])
    base = fit_base(data, mechanism, PAPER.theta)
    (found,) = try_candidate(base, None, "drive_resonance")
    before = _evidence(base, found)

    def left(lasting: bool) -> float:
        after = _Noise.on(data, base, lasting).taken_off(found, before)
        return float((after.observed.sum(axis=0) / before.observed.sum(axis=0))[-1])

    assert left(lasting=False) > 0.6
    assert abs(left(lasting=True)) < 0.25


def test_noise_of_the_torques_that_lasts_is_taken_off_the_evidence_of_a_dead_zone():
    """It is in the column, whose step it moves, and in the residual; white noise is a part of it.

    Of several logs the mean: the evidence of one has a standard deviation of one.
    """
    log, mechanism = recording(noise=0.0, rate=50.0), mechanism_of(PAPER)
    keep = np.exp(-log.dt / 0.25)

    def deviations(seed: int) -> list[float]:
        rng = np.random.default_rng(seed)
        white = rng.standard_normal((2, len(log), 4))
        lasting = 0.06 * np.sqrt(1 - keep**2) * coloured_columns(white[0], keep)
        noisy = replace(log, velocity=log.velocity + 0.01 * white[1], effort=log.effort + lasting)
        data = LoggedData(mechanism, [noisy])
        base = fit_base(data, mechanism, PAPER.theta)
        (found,) = try_candidate(base, None, "dead_zone")
        before = _evidence(base, found)
        after = (_Noise.on(data, base, lasting=by).taken_off(found, before) for by in (False, True))
        return [deviation(evidence) for evidence in (before, *after)]

    before, less_white, less_its_own = np.mean([deviations(seed) for seed in range(4)], axis=0)
    assert min(before, less_white) > 3.0
    assert abs(less_its_own) < 1.5


def deviation(evidence: Evidence) -> float:
    """Of a score with one column, in standard deviations."""
    blocks = evidence.observed[:, 0]
    return float(blocks.sum() / np.sqrt((blocks**2).sum()))


def test_what_noise_makes_of_the_structures_own_columns_is_taken_off_too():
    """It makes masses too small, and a delay's column, which they explain in part, shows that."""
    rng, log = np.random.default_rng(5), recording(noise=0.0)
    mechanism = mechanism_of(PAPER)
    noisy = [log.velocity, log.effort] + np.array([0.1, 0.03])[:, None, None] * (
        rng.standard_normal((2, len(log), 4))
    )
    data = LoggedData(mechanism, [replace(log, velocity=noisy[0], effort=noisy[1])])
    base = fit_base(data, mechanism, PAPER.theta)
    (found,) = try_candidate(base, None, "torque_delay")
    before = _evidence(base, found)
    after = _Noise.on(data, base).taken_off(found, before)
    assert abs(deviation(before)) > 4.0
    assert abs(deviation(after)) < 2.5


def coloured_columns(white, decay):
    return lfilter([1.0], [1.0, -decay], white, axis=0)


def coloured(rng, count, decay):
    white = rng.standard_normal((count, 3))
    out = np.empty_like(white)
    out[0] = white[0]
    for k in range(1, count):
        out[k] = decay * out[k - 1] + white[k]
    return out


def p_of(scores, rng, draws=999):
    blocks = len(next(iter(scores.values())).observed)
    return candidate_p_values(scores, random_signs(rng, draws, blocks))


def blocks_of(residual, base, columns):
    span = Span(stacked(base), DiagnosisSettings().min_seen_share)
    return score_blocks(residual, span, columns, 0.05)


def evidence(residual, base, columns):
    return Evidence(blocks_of(residual, base, columns))


def test_false_alarms_stay_at_their_level_on_correlated_residuals():
    """Residual and candidates share the filter's memory, where F tests raise alarms in 8-45 %."""
    alarms, trials = 0, 200
    rng = np.random.default_rng(2)
    for _ in range(trials):
        residual = [coloured(rng, 1200, 0.8)]
        base = [np.stack([coloured(rng, 1200, 0.95) for _ in range(2)], axis=-1)]
        scores = {
            f"c{k}": evidence(residual, base, [coloured(rng, 1200, 0.95)[..., None]])
            for k in range(6)
        }
        alarms += min(p_of(scores, rng, 199).values()) <= 0.05
    assert 0.01 <= alarms / trials <= 0.10


def test_a_true_candidate_is_found_and_the_others_are_not():
    rng = np.random.default_rng(3)
    base = [coloured(rng, 2400, 0.95)[..., None]]
    columns = {name: [coloured(rng, 2400, 0.95)[..., None]] for name in "abcd"}
    residual = [coloured(rng, 2400, 0.8) + 0.3 * columns["b"][0][..., 0]]
    scores = {name: evidence(residual, base, c) for name, c in columns.items()}
    p_values = p_of(scores, rng)
    assert p_values["b"] == pytest.approx(0.001)
    assert min(p_values[name] for name in "acd") > 0.05


def test_a_column_that_the_base_model_holds_already_has_no_evidence():
    rng = np.random.default_rng(4)
    base = [coloured(rng, 1200, 0.9)[..., None]]
    residual = [coloured(rng, 1200, 0.8)]
    blocks = blocks_of(residual, base, [2.0 * base[0]])
    assert np.abs(blocks).max() < 1e-9 * np.abs(residual[0]).sum()


@pytest.mark.parametrize("size", [0.0, 8.0], ids=["nothing", "a limit of the torque"])
def test_what_acts_in_few_moments_is_judged_by_what_it_leaves(size):
    """Random signs of the few large blocks alone would yield scores as large as theirs."""
    rng = np.random.default_rng(5)
    p_values = []
    for _ in range(20):
        column = coloured(rng, 2400, 0.9)
        column[120:-120] *= 1e-3  # twelve of 120 s
        noise = coloured(rng, 2400, 0.8)
        residual, column = [noise + size * column], column[..., None]
        base = [coloured(rng, 2400, 0.95)[..., None]]
        observed = blocks_of(residual, base, [column])
        chance = blocks_of([noise], base, [column])
        found = p_of({"rare": Evidence(observed, chance)}, rng)
        p_values.append(found["rare"])
        if size:
            assert p_of({"rare": Evidence(observed)}, rng)["rare"] > found["rare"]
    assert (max(p_values) <= 0.01) if size else (0.2 < np.mean(p_values) < 0.8)
