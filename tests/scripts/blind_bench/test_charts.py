"""The charts of a bench say what its records say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from identification.figures.chart_style import Chart
from tests.scripts.test_bench import record, said
from tests.scripts.test_reports import charts, stands_alone, visible
from youbot_scripts.blind_bench.charts import (
    answer_kind,
    answers_chart,
    calibration_chart,
    charts_of,
    confusion_chart,
    rates_chart,
    sizes_chart,
    write_report,
)
from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.blind_bench.report import not_right, tables
from youbot_scripts.blind_bench.scores import score

COULOMB = "wheel_coulomb_friction"
STATED = {f"{COULOMB}.torque": {"value": 0.21, "std": 0.01}}
RIGHT = record(COULOMB, said("effect", COULOMB), sizes=STATED)
WRONG = record(COULOMB, said("effect", "yaw_scrub"))
UNSURE = record(COULOMB, said("ambiguous", "yaw_scrub", yaw_scrub=[COULOMB]))
MISSED = record(COULOMB, said("adequate"))
EMPTY = record("", said("adequate"), kind="none")
RECORDS = [RIGHT, RIGHT, WRONG, UNSURE, MISSED, EMPTY]


def drawn(chart: Chart) -> Any:
    """The chart's Plotly figure, whose attributes its types do not know."""
    return chart.figure


def traces(chart: Chart) -> dict[str, Any]:
    """The chart's lines, marks and bars by name."""
    return {trace.name: trace for trace in drawn(chart).data}


def test_intervals_are_wilson_s():
    low, high = Proportion(8, 10).wilson()
    assert (low, high) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    low, high = Proportion(0, 10).wilson()
    assert low == 0.0 and high == pytest.approx(0.2775, abs=1e-4)
    assert Proportion(0, 0).wilson() == (0.0, 1.0)


def test_rates_have_a_row_a_kind_with_what_is_wanted():
    figure = drawn(rates_chart(RECORDS))
    shown, wanted = figure.data[0], figure.data[1]
    assert list(shown.x) == [60.0, 100.0] and list(shown.y) == [0, 1]
    assert figure.layout.yaxis.ticktext == ("one (5)", "none (1)")
    assert list(wanted.x) == [97.0, 99.0]
    high = shown.x[0] + shown.error_x.array[0]
    assert high == pytest.approx(100 * Proportion(3, 5).wilson()[1])


def test_calibration_counts_what_intervals_hold():
    """One deviation off: outside at 50 and 68 %, inside from 80 % on."""
    (sizes,) = [t for t in drawn(calibration_chart([RIGHT])).data if "sizes" in t.name]
    assert list(sizes.y) == [0.0, 0.0, 100.0, 100.0, 100.0, 100.0] and "(1)" in sizes.name


def test_sizes_are_in_stated_deviations():
    stated = {f"{COULOMB}.torque": {"value": 0.9, "std": 0.01}}
    far = record(COULOMB, said("effect", COULOMB), sizes=stated)
    found = traces(sizes_chart([RIGHT, far]))
    assert found["inside the 95 % interval"].x[0] == pytest.approx(1.0)
    assert list(found["outside"].x) == [5.0], "what is far off stands at the edge"


@pytest.mark.parametrize(
    ("one", "kind"),
    [
        (RIGHT, "named, alone"),
        (WRONG, "another name"),
        (UNSURE, "named, in a set of at most three"),
        (MISSED, "nothing found"),
        (EMPTY, "right otherwise"),
        (record("carpet_nap", said("unknown")), "right otherwise"),
        (record(COULOMB, said("unknown")), "unknown"),
        ({**RIGHT, "found": {}}, "error"),
    ],
)
def test_every_answer_has_its_colour(one: dict, kind: str):
    assert answer_kind(one) == kind


def test_answers_and_confusion_count_the_cases():
    bars = traces(answers_chart(RECORDS))
    assert bars["named, alone"].x == (0.0, 40.0) and bars["another name"].x == (0.0, 20.0)
    (cells,) = drawn(confusion_chart(RECORDS)).data
    found = {
        (truth, told): text
        for truth, row in zip(cells.y, cells.text, strict=True)
        for told, text in zip(cells.x, row, strict=True)
        if text
    }
    assert found[COULOMB, COULOMB] == "2" and found[COULOMB, "yaw_scrub"] == "2"
    assert found[COULOMB, "adequate"] == "1" and found["nothing", "adequate"] == "1"


def test_the_page_stands_alone(tmp_path: Path):
    path = tmp_path / "page.html"
    records = [{**one, "case": {**one["case"], "index": k}} for k, one in enumerate(RECORDS)]
    write_report(path, records, tables(score(records)), not_right(records), 3)
    page = path.read_text()
    assert stands_alone(page) and "seed 3" in page
    assert charts(page) == {"rates", "calibration", "sizes", "answers", "confusion"}
    assert "Right: one 3 of 5, none 1 of 1; named what nobody planted: 1 of 6" in visible(page)
    assert page.count("not right: ") == 2


def test_records_without_an_answer_have_no_chart():
    broken = {key: value for key, value in EMPTY.items() if key != "found"}
    assert list(charts_of([{**broken, "error": "x", "error_class": "KeyError"}])) == []
