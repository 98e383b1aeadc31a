"""Results at a prompt and in a notebook: short, escaped, with charts and a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification import add_effect, compare, diagnose, identify
from identification.showing import Shown
from tests.identification.recordings import recording
from youbot_env import load_model
from youbot_env.errors import InputError

TILT = (("floor_tilt", (("tilt_x", 0.018), ("tilt_y", 0.0))),)


@pytest.fixture(scope="module")
def results() -> dict[str, Shown]:
    """One result of each kind, of the same log."""
    logs, paper = [recording("calibration", TILT, rate=50.0)], load_model("paper")
    return {
        "identification": identify(logs),
        "comparison": compare(paper, logs),
        "diagnosis": diagnose(paper, logs, effects=["floor_tilt", "quadratic_friction"]),
        "addition": add_effect(paper, "floor_tilt", logs),
    }


KINDS = pytest.mark.parametrize("kind", ["identification", "comparison", "diagnosis", "addition"])


@KINDS
def test_a_result_is_short_at_the_prompt(results: dict[str, Shown], kind: str):
    text = repr(results[kind])
    assert len(text) < 500 and "\n" not in text and "force error" in text


@KINDS
def test_a_notebook_shows_the_summary_and_a_table(results: dict[str, Shown], kind: str):
    html = results[kind]._repr_html_()
    assert html.count("<tr>") == 1 + len(results[kind].rows()) and "force error" in html


@KINDS
def test_charts_by_name_and_a_page(results: dict[str, Shown], kind: str, tmp_path: Path):
    pytest.importorskip("plotly")
    charts = results[kind].charts
    assert {"identification": "forces_0", "comparison": "free_run_0"}.get(kind, "errors") in charts
    name = list(charts)[-1]
    assert results[kind].plot(name).to_json() == charts[name].to_json()
    with pytest.raises(InputError, match="no chart 'x'; there are"):
        results[kind].plot("x")
    results[kind].report(tmp_path / "page.html")
    assert f'data-for="{name}"' in (tmp_path / "page.html").read_text("utf-8")


def test_the_verdict_is_one_sentence(results: dict[str, Shown]):
    assert results["diagnosis"].summary().startswith("The model lacks floor tilt: the force error")


def test_a_data_frame_is_the_main_table(results: dict[str, Shown]):
    pytest.importorskip("pandas")
    frame = results["identification"].to_dataframe()
    assert list(frame["parameter"])[:2] == ["m0", "I0"] and np.isfinite(frame["value"]).all()


def test_names_are_escaped():
    class Evil(Shown):
        def summary(self) -> str:
            return "<script>"

        def rows(self) -> list[dict[str, object]]:
            return [{"<b>": "<i>"}]

    html = Evil()._repr_html_()
    assert "<script>" not in html and "<b>" not in html and "<i>" not in html
