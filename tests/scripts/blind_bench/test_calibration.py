"""The calibration page and the baseline: their arithmetic, and what they say of known records."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_scripts.blind_bench.baseline import discoveries, stepwise
from youbot_scripts.blind_bench.calibration import Row, row_of, rows_of
from youbot_scripts.blind_bench.calibration_page import Run, made_by, page
from youbot_scripts.blind_bench.null_fits import null_fits, null_p_values
from youbot_scripts.blind_bench.scores import score


def trial(kind: str, planted: list[str], said: list[str], **more: Any) -> dict[str, Any]:
    """A record of the bench, as far as the page reads it."""
    found = {"verdict": "effect" if said else "adequate", "missing": said, "ambiguous_with": {}}
    case = {"kind": kind, "planted": [{"name": n, "values": {}} for n in planted], "rate": 100.0}
    case |= {"platform": {"m0": 35.0, "mu1": 0.1}, "index": 0, "key": "k", "sensing": None}
    return {"case": case, "found": found, "carriers": [], "seconds": 1.0, **more}


def fit(kind: str, off: float, p_value: float) -> dict[str, Any]:
    """A cheap fit whose parameters are ``off`` deviations from the truth."""
    base = {"m0": {"value": 35.0 + off, "std": 1.0}, "mu1": {"value": 0.1, "std": None}}
    record = {"fit": "f", "base": base, "misfit": False, "p_value": p_value, "map_p_value": 0.5}
    # The map tells a variable where candidates are significant, too.
    told = {"leading": ["twist"] if p_value < 0.01 else []}
    return trial(kind, [], []) | record | told


def test_the_standard_error_is_that_of_a_binomial_where_replicates_state_one_thing():
    hits = np.random.default_rng(0).random(400) < 0.9
    row = row_of("a", "90 %", ([bool(hit)] for hit in hits))
    assert row is not None and row.replicates == 400
    share = hits.mean()
    assert row.std == pytest.approx(np.sqrt(share * (1 - share) / 400), rel=0.01)


def test_numbers_of_one_replicate_are_no_more_than_one():
    rng = np.random.default_rng(1)
    once = [[bool(rng.random() < 0.9)] for _ in range(300)]
    seven = row_of("a", "", (one * 7 for one in once))
    alone = row_of("a", "", once)
    assert seven is not None and alone is not None
    assert seven.std == pytest.approx(alone.std, rel=1e-9)


def test_a_few_that_all_hold_do_not_prove_a_promise_nor_break_it():
    row = Row("a", "95 %", (3, 3), (3, 3), 0.93, 0.97)
    assert row.share == 1.0 and row.std > 0.1 and not row.falls_short
    many = Row("a", "95 %", (50,) * 100, (100,) * 100, 0.93, 0.97)
    assert many.falls_short
    assert row_of("nothing", "", [[], []]) is None


def test_the_page_tells_what_came_of_each_promise():
    fits = [fit("none", off, p) for off, p in ((0.5, 0.004), (1.0, 0.3), (2.5, 0.5), (0.1, 0.03))]
    records = [
        trial("none", [], [], baseline={"verdict": "adequate", "missing": []}),
        trial("none", [], ["floor_tilt"], baseline={"verdict": "effect", "missing": ["tether"]}),
    ]
    rows = {row.what: row for part in rows_of(records, fits, fits).values() for row in part}
    inside = rows["base parameters by `identify`, calibration motion alone, white noise"]
    assert inside.hits == (1, 1, 0, 1) and inside.of == (1, 1, 1, 1)
    assert rows["least p-value of all candidates is 0.05 or less, white noise"].share == 0.5
    assert rows['verdict "adequate", nothing missing, white noise'].share == 0.5
    assert rows["the baseline: a name that nobody planted, nothing missing, white noise"].hits == (
        *(0, 1),
    )
    text = page(
        rows_of(records, fits, fits), Run(len(fits), len(fits), len(records), 1, 7, "Commit 123")
    )
    assert "| 75.0% |" in text and "Commit 123. 4 fits, p-values of 4, 2 diagnoses" in text


def test_the_page_names_the_commits_that_made_its_results():
    """Not the present one: a page may be made of results that were saved long ago."""
    old, new = {"commit": "abc"}, {"commit": "def"}
    assert made_by([old, old]) == "Commit abc"
    assert made_by([old, new, new, {}]) == (
        "Commits def (2 results), abc (1 results), not recorded (1 results)"
    )


def test_p_values_by_kind_of_noise_tell_what_is_there_from_what_is_chance():
    fits = []
    for name, p_value in (("hum", 0.001), ("hum", 0.7), ("torque_wander", 0.001)):
        record = fit("noise", 0.5, p_value)
        record["case"]["sensing"] = {"name": name, "values": {}}
        fits.append(record)
    tables = rows_of([], [], fits)
    where = "least p-value of all candidates is 0.05 or less, "
    both = {row.what: row for row in tables["p-values where nothing is missing"]}
    other, offset = both[f"{where}other noise"], both[f"{where}noise that leaves an offset"]
    assert other.hits == (1, 0) and other.most == 0.05
    assert offset.hits == (1,) and not offset.falls_short
    told = "the map tells a variable that the error depends on, "
    assert both[f"{told}other noise"].hits == (1, 0) and both[f"{told}other noise"].most == 0.05
    assert not both[f"{told}noise that leaves an offset"].falls_short
    rows = {row.what.rpartition(", ")[2]: row for row in tables["p-values by kind of noise"]}
    assert set(rows) == {"hum", "torque wander"}
    assert rows["hum"].hits == (1, 0) and rows["hum"].most == 0.05
    assert rows["torque wander"].share == 1.0 and not rows["torque wander"].falls_short
    assert "drive_resonance" in page(tables, Run(0, len(fits), 0, 1, 7, "Commit 1"))


def test_the_baseline_is_scored_beside_the_diagnosis():
    named = {"verdict": "effect", "missing": ["floor_tilt", "tether"]}
    record = trial("one", ["floor_tilt"], ["floor_tilt"], baseline=named)
    found = score([record | {"identify": {"base": {}}}])["kinds"]["one"]
    assert found["named_exactly"]["share"] == 1.0
    assert found["baseline_named_exactly"]["share"] == 0.0
    assert found["baseline_right"]["share"] == 1.0
    assert found["baseline_wrongly_named"]["share"] == 1.0


def test_benjamini_and_hochberg():
    assert discoveries([0.9, 0.001, 0.04, 0.6], 0.05) == [1]
    assert discoveries([0.03, 0.02, 0.04, 0.05], 0.05) == [1, 0, 2, 3]
    assert discoveries([0.2, 0.5], 0.05) == [] == discoveries([], 0.05)


@pytest.mark.slow
def test_the_baseline_names_what_is_planted():
    log = recording("calibration", (("floor_tilt", (("tilt_x", 0.03),)),))
    found = stepwise(load_model("paper"), [log])
    assert found.missing[0] == "floor_tilt" and found.p_values[0] < 1e-6
    assert found.to_dict()["verdict"] == "effect"


@pytest.mark.slow
def test_fits_are_resumed(tmp_path):
    first = null_fits(2, 3, folder=tmp_path)
    assert [record["case"]["kind"] for record in first] == ["none", "noise"]
    assert not any(record["misfit"] for record in first)
    assert null_fits(2, 3, folder=tmp_path) == first
    (ranked,) = null_p_values(1, 3, folder=tmp_path)
    assert 0 < ranked["p_value"] <= 1 and 0 < ranked["map_p_value"] <= 1
    assert ranked["case"] == first[0]["case"]
    assert null_p_values(1, 3, folder=tmp_path) == [ranked]
