"""Charts of long logs: thinned as a whole, in full where they are zoomed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from youbot_scripts.interactive.drawing import save
from youbot_scripts.interactive.parts import themed
from youbot_scripts.interactive.signals import BINS, COLOURS, Drawn, looks_of

RATE = 1000.0
"""[Hz]"""


def drawn(folder: Path, seconds: float) -> Drawn:
    """A log of three speeds that the model misses by noise; one sample is far off."""
    count = round(RATE * seconds)
    time = np.arange(count) / RATE
    measured = np.sin(time)[:, None] * np.ones(3)
    measured[count // 2] = 7.0
    save(folder / "velocity_0_time.npy", time)
    save(folder / "velocity_0_measured.npy", measured)
    save(folder / "velocity_0_predicted_0.npy", 0.9 * measured)
    speeds = [["$V_X$", "m/s"], ["$V_Y$", "m/s"], ["$W$", "rad/s"]]
    about = {"models": ["paper"], "logs": ["long"], "speeds": speeds, "forces": speeds}
    (folder / "charts.json").write_text(json.dumps(about))
    return Drawn(folder)


def lines_of(figure: Any) -> list[Any]:
    return [trace for trace in figure.data if trace.mode == "lines"]


def test_points_of_the_floor_plan_travel_with_their_times(tmp_path: Path):
    """Dash tells the custom data of selected points only where they are a list in the JSON."""
    log = drawn(tmp_path, 4.0)
    for name, of in (("time", "time"), ("measured", "measured"), ("predicted_0", "predicted_0")):
        save(tmp_path / f"force_0_{name}.npy", log.array(f"velocity_0_{of}"))
    save(tmp_path / "pose_0.npy", np.column_stack([log.array("velocity_0_time")] * 3))
    (trace,) = json.loads(log.plan(0, [(1.0, 2.0)]).to_json())["data"]
    times = trace["customdata"]
    assert isinstance(times, list) and times == sorted(times)
    chosen = log.plan(0, [(1.0, 2.0)]).data[0].selectedpoints
    marked = [times[k] for k in chosen]
    assert marked and all(1.0 <= at <= 2.0 for at in marked)


@pytest.mark.parametrize("seconds", [60.0, pytest.param(3600.0, marks=pytest.mark.slow)])
def test_a_long_log_is_thinned_and_a_stretch_of_it_is_whole(tmp_path: Path, seconds: float):
    log = drawn(tmp_path, seconds)
    figure, _ = log.signals("velocity", 0, None, [])
    assert all(len(line.x) <= 2 * BINS + 2 for line in lines_of(figure))
    assert len(figure.to_json()) < 1.5e6
    first = lines_of(figure)[0]
    assert np.max(first.y) == 7.0, "no extreme is lost"
    middle = seconds / 2
    figure, _ = log.signals("velocity", 0, (middle - 0.4, middle + 0.4), [(middle, middle + 0.1)])
    near = lines_of(figure)[0]
    assert 800 <= len(near.x) <= 803, "every row of what is seen"
    assert figure.layout.shapes, "the mark is drawn"


def test_a_model_keeps_its_colour_whatever_it_is_compared_with():
    order = [f"model_{k}" for k in range(9)]
    for names in (["model_1"], ["model_1", "model_2"], ["model_0", "model_1"]):
        of_name = dict(zip(names, looks_of(names, order), strict=True))
        assert of_name["model_1"]["color"] == COLOURS[1]
    one, other = looks_of(["model_1", f"model_{1 + len(COLOURS)}"], order)
    assert one["color"] != other["color"], "a whole round apart"
    assert len(looks_of(["stranger"], order)) == 1


def test_a_chart_of_a_file_gets_faint_lines_for_the_dark_too():
    """Every axis of it: Plotly's own lines are black on white and white on black."""
    figure = {"data": [], "layout": {"xaxis": {}, "yaxis": {}, "xaxis3": {"title": "x"}}}
    layout = themed(figure)["layout"]
    assert all("128" in layout[name]["gridcolor"] for name in ("xaxis", "yaxis", "xaxis3"))
    assert layout["xaxis3"]["title"] == "x"


def test_dots_that_are_not_marked_stay_faint_where_they_overlap(tmp_path: Path):
    log = drawn(tmp_path, 4.0)
    for name in ("time", "measured", "predicted_0"):
        save(tmp_path / f"force_0_{name}.npy", log.array(f"velocity_0_{name}"))
    save(tmp_path / "pose_0.npy", np.column_stack([log.array("velocity_0_time")] * 3))
    opacity = log.plan(0, [(1.0, 2.0)]).data[0].unselected.marker.opacity
    assert 1.0 - (1.0 - opacity) ** 5 < 0.5
