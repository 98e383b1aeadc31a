"""The paper's statements on what each calibration motion can see, and its one misprint."""

import numpy as np
import pytest

from identification.doctor import log_shows
from identification.fitting.ideal_motions import motion_observability
from identification.fitting.identify import identify
from identification.fitting.observability import (
    block_estimates,
    log_observability,
    observability,
    refuse_blind,
)
from identification.fitting.regression import Regression, regression
from identification.logs.log import AXIS, Log
from identification.mechanisms.axis_model import base_axis_model
from identification.mechanisms.calibration_parts import parts_of
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.paper_regressor import (
    PAPER_ORDER,
    ideal_columns,
    motion_that_shows,
)
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import motion_i, motion_ii, motion_iii, motion_iv
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")
ENGINE = Mecanum(Geometry(), mecanum_structure())


def whole_periods(motion):
    """A stretch of whole periods inside a motion's plateau."""
    part = getattr(motion, "parts", [motion])[0]
    period = 2 * np.pi / part.frequency
    start = part.plateau[0]
    return (start, start + int((part.plateau[1] - start) / period + 1e-6) * period), period


def seen_by(motion):
    window, period = whole_periods(motion)
    return motion_observability(motion, window=window, dt=period / 400)


@pytest.mark.parametrize(
    ("motion", "rank", "blind", "blocks"),
    [
        (motion_i(), 6, ["x1 + x2 + x5"], {("m_aX",), ("mu1", "mu2"), ("m0", "I0", "I1", "m_aY")}),
        (motion_ii(), 6, ["x1 + x2 - x4"], {("m_aY",), ("mu1", "mu2"), ("m0", "I0", "I1", "m_aX")}),
        (motion_iv(), 6, ["x1"], None),
    ],
    ids=["I", "II", "IV"],
)
def test_rank_blind_direction_and_blocks(motion, rank, blind, blocks):
    found = seen_by(motion)
    assert found.rank == rank
    assert found.describe_blind() == blind
    if blocks:
        assert set(found.blocks) == blocks


def test_the_papers_misprint_is_not_blind_in_motion_ii():
    """The paper prints x1 + x3 - x4; its own H sees that direction, and x1 + x2 - x4 is blind."""
    found = seen_by(motion_ii())
    printed = np.array([1, 0, 1, -1, 0, 0, 0]) / np.sqrt(3)
    derived = np.array([1, 1, 0, -1, 0, 0, 0]) / np.sqrt(3)
    largest = np.linalg.eigvalsh(found.gramian).max()
    assert derived @ found.gramian @ derived < 1e-9 * largest
    assert printed @ found.gramian @ printed > 1e-3 * largest


def test_motion_iii_is_blind_to_two_directions():
    found = seen_by(motion_iii())
    assert found.rank == 5
    assert sorted(found.describe_blind()) == ["x1 - x3", "x2"]
    blocks = [set(block) for block in found.blocks]
    assert {"mu1", "mu2"} in blocks and {"m0", "I1"} in blocks
    assert all(not ({"m_aX", "m_aY"} & block and {"m0", "I1"} & block) for block in blocks)


def test_one_and_two_together_see_everything():
    gramians = [seen_by(motion).gramian for motion in (motion_i(), motion_ii())]
    for gramian in gramians:
        assert np.linalg.matrix_rank(gramian, tol=1e-9 * np.linalg.eigvalsh(gramian).max()) == 6
    together = sum(gramians)
    assert np.linalg.eigvalsh(together).min() > 1e-4 * np.linalg.eigvalsh(together).max()


def test_a_recorded_calibration_is_parted_and_judged_as_the_paper_says():
    samples = ENGINE.samples(recording())
    rows = regression(ENGINE, PAPER.theta, samples, np.arange(7))
    parts = {part.kind: part for part in parts_of(samples)}
    assert list(parts) == ["I", "III", "II", "IV"]
    ranks = {
        kind: log_observability(ENGINE, [rows.between(part.start, part.end)]).rank
        for kind, part in parts.items()
    }
    assert ranks["I"] == 6 and ranks["II"] == 6 and ranks["III"] == 5
    assert log_observability(ENGINE, [rows]).rank == 7


def test_a_block_is_estimated_where_others_are_blind():
    """Motion I cannot show m0, yet its frictions and m_aX come out right, within their interval."""
    samples = ENGINE.samples(recording())
    part = next(part for part in parts_of(samples) if part.kind == "I")
    rows = regression(ENGINE, PAPER.theta, samples, np.arange(7))
    rows = rows.between(part.start, part.end)
    estimates = block_estimates(ENGINE, PAPER.theta, rows, log_observability(ENGINE, [rows]))
    assert set(estimates) == {"m_aX", "mu1", "mu2"}
    for name, (value, std) in estimates.items():
        expected = PAPER.theta[ENGINE.parameter_names.index(name)]
        assert abs(value - expected) < 4 * std
        assert std < 0.6 * abs(expected)


def test_own_columns_suffice_for_a_block_of_an_ideal_motion():
    """What spoils another block leaves this one alone: the benefit of estimating by blocks."""
    motion = motion_i()
    (start, end), period = whole_periods(motion)
    time = np.arange(start, end - 1e-9, period / 400)
    columns = ideal_columns(ENGINE.geometry, motion.twist(time), motion.acceleration(time))
    x = (PAPER.theta * ENGINE.scale)[list(PAPER_ORDER)]
    measured = np.einsum("naf,f->na", columns, x)
    wrong = measured + 3.0 * columns[..., 2]  # an inertia that no model knows of
    block = columns[..., [5, 6]].reshape(-1, 2)
    alone = np.linalg.lstsq(block, wrong.ravel(), rcond=None)[0]
    np.testing.assert_allclose(alone, x[[5, 6]], rtol=1e-9)


def test_what_a_log_cannot_show_is_said_with_the_motion_that_would_show_it():
    with pytest.raises(InputError, match=r"cannot show .*x2.*record motion (I|II|IV)\b"):
        identify([recording("III")])
    direction = np.array([1, 1, 0, 0, 1, 0, 0]) / np.sqrt(3)
    assert motion_that_shows(ENGINE.geometry, direction) in ("II", "III", "IV")


@pytest.mark.parametrize(("eigenvalue", "refused"), [(2e-3, False), (5e-4, True)])
def test_what_is_hardly_seen_is_fitted_and_what_is_not_seen_refused(
    eigenvalue: float, refused: bool
):
    """Torques that a limit cuts hardly move a platform: no reason to give no model at all."""
    seen = observability(list(ENGINE.parameter_names), hardly_apart(eigenvalue), 0.05)
    assert seen.rank == 6 and seen.least == pytest.approx(eigenvalue, rel=0.1)
    if not refused:
        refuse_blind(ENGINE, seen)
        return
    with pytest.raises(InputError, match="cannot show"):
        refuse_blind(ENGINE, seen)


def hardly_apart(eigenvalue: float) -> np.ndarray:
    """Columns (n, 7, 7), the first two nearly alike: the Gramian's least eigenvalue is given."""
    columns = np.zeros((500, 7, 7))
    columns[:, range(7), range(7)] = 1.0
    angle = np.arccos(1 - eigenvalue)
    columns[:, :2, 0], columns[:, :2, 1] = (1.0, 0.0), (np.cos(angle), np.sin(angle))
    return columns


def test_a_column_of_noise_is_not_taken_for_information():
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((500, 3, 2))
    columns[..., 1] *= 1e-3
    found = observability(["a", "b"], columns, 0.05)
    assert found.rank == 1
    np.testing.assert_allclose(np.abs(found.blind[0]), [0, 1], atol=1e-3)


def test_rows_need_no_filter_settled_twice():
    rows = Regression(np.arange(5.0), 1.0, np.zeros((5, 3)), np.ones((5, 3, 7)))
    assert len(rows.between(1.0, 3.0).time) == 2


class TestStandstill:
    """A joint that stands still for most of a log and moves one way shows less than it seems."""

    @staticmethod
    def log(way_back: bool = False, counts: float = 0.0) -> Log:
        time, rng = np.arange(0, 40, 0.01), np.random.default_rng(0)
        bump = np.where((time > 5) & (time < 12), 1 - np.cos(2 * np.pi * (time - 5) / 7), 0.0)
        bump += np.where(
            (time > 5) & (time < 12), 0.3 - 0.3 * np.cos(4 * np.pi * (time - 5) / 7), 0
        )
        speed = bump - np.roll(bump, 1500) if way_back else bump
        effort = 0.5 * np.gradient(speed, time) + 0.3 * speed + 0.4 * np.tanh(speed / 0.01) + 0.1
        noisy = speed + 0.003 * rng.standard_normal(len(time))
        shown = np.round(noisy / counts) * counts if counts else noisy
        effort = effort + 0.01 * rng.standard_normal(len(time))
        return Log("drive", AXIS, time, shown[:, None], effort[:, None])

    @pytest.mark.parametrize("counts", [0.0, 0.02])
    def test_noise_and_counts_at_rest_are_no_evidence_of_friction(self, counts: float):
        log = self.log(counts=counts)
        model = base_axis_model([log], every=True)
        shown = log_shows(log, mechanism_of(model), model.theta)
        assert shown.total.rank == 3 and shown.total.describe_blind() == ["x3 - x4"]
        result = identify([log], start=model, recursive=False)
        assert set(result.at_rest) == {"coulomb", "offset"}
        assert any("told apart by standstill alone" in line for line in result.warnings)
        found = result.to_dict()["parameters"]
        assert found["coulomb"]["interval"] is None and found["coulomb"]["std"] > 0

    def test_with_a_motion_both_ways_they_are_shown(self):
        log = self.log(way_back=True)
        model = base_axis_model([log], every=True)
        assert log_shows(log, mechanism_of(model), model.theta).total.rank == 4
        assert identify([log], start=model, recursive=False).at_rest == ()

    def test_a_stretch_without_any_motion_shows_nothing(self):
        seen = observability(("a", "b"), np.zeros((0, 1, 2)), 0.1)
        assert seen.rank == 0
