"""Figures show the result's own numbers, leave pyplot alone, and reach the disk whole or not."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from controllers.recording import record
from identification.comparison import Comparison, compare
from identification.figures import (
    failures,
    figures,
    single_charts,
    style,
    time_series,
)
from identification.fitting.errors import (
    SumsOfSquares,
    Traces,
    force_traces,
)
from identification.fitting.estimate_history import EstimateHistory
from identification.fitting.identify import Identification, identify
from identification.logs.log import Log
from identification.logs.reading import read_log, write_log
from identification.logs.recorded_motion import recorded_motion
from identification.mechanisms.axis_model import base_axis_model
from identification.mechanisms.quantities import of_platform
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from tests.identification.recordings import recording
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import Motion
from youbot_env.motions.multisine import multisine
from youbot_scripts.cli import main

PAPER = load_model("paper")


@pytest.fixture(scope="module")
def calibration() -> Log:
    return recording("calibration", rate=50.0)


@pytest.fixture(scope="module")
def fitted(calibration: Log) -> Identification:
    return identify([calibration])


@pytest.fixture(scope="module")
def driven() -> tuple[Motion, Log]:
    """A short multisine and the log of a run along it."""
    motion = multisine(np.random.default_rng(3), duration=20.0, tones=3, name="multisine_s")
    return motion, record(PAPER, [motion], rate=50.0, seed=1)[0]


@pytest.fixture(scope="module")
def compared(fitted: Identification, driven: tuple[Motion, Log]) -> Comparison:
    return compare(fitted.model, [driven[1]])


def drawn(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def legend_of(figure: Figure) -> list[str]:
    (legend,) = [legend for axes in figure.axes if (legend := axes.get_legend())]
    return [text.get_text() for text in legend.get_texts()]


def small_traces(rows: int = 200) -> Traces:
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, 4.0, rows)
    measured = np.array([3.0, 2.0, 1.0]) * np.sin(np.multiply.outer(time, [1.0, 2.0, 3.0]))
    return Traces(time, measured, measured + 0.1 * rng.standard_normal(measured.shape))


def floor_of(traces: Traces, std: float) -> SumsOfSquares:
    return SumsOfSquares(np.full(3, len(traces.time) * std**2), (traces.measured**2).sum(axis=0))


class TestForceFigure:
    def test_lines_are_the_traces(self):
        traces = small_traces()
        figure = time_series.force_figure(traces, floor_of(traces, 0.1), name="run")
        for k in range(3):
            main_panel, strip = figure.axes[2 * k : 2 * k + 2]
            for label, values in (
                ("measured torques", traces.measured),
                ("model", traces.predicted),
            ):
                time, shown = drawn(main_panel, label)
                np.testing.assert_array_equal(time, traces.time)
                np.testing.assert_array_equal(shown, values[:, k])
            (residual,) = strip.get_lines()
            np.testing.assert_array_equal(residual.get_ydata(), traces.residual[:, k])

    def test_noise_band_is_95_percent_of_the_floor(self):
        traces = small_traces()
        figure = time_series.force_figure(traces, floor_of(traces, 0.1), name="run")
        for strip in figure.axes[1::2]:
            (band,) = strip.patches
            low, high = band.get_extents().transformed(strip.transData.inverted()).intervaly
            assert (low, high) == pytest.approx((-0.196, 0.196))
            assert strip.get_ylim()[1] > 0.196, "the band is in sight"

    def test_labels_units_and_legend(self):
        traces = small_traces()
        figure = time_series.force_figure(traces, floor_of(traces, 0.1), name="run_7")
        labels = [axes.get_ylabel() for axes in figure.axes]
        assert all("[N m]" in label for label in labels)
        assert [label.split("  ")[0] for label in labels[::2]] == [
            r"$L\,F_X$",
            r"$L\,F_Y$",
            "$M_W$",
        ]
        assert figure.axes[-1].get_xlabel() == "time from the log's start [s]"
        assert "run_7" in figure.axes[0].get_title(loc="left")
        expected = {"measured torques", "model", r"difference $\Delta$", "noise floor, ±1.96 std"}
        assert set(legend_of(figure)) == expected

    def test_an_axis_that_never_moved_is_drawn_all_the_same(self):
        still = Traces(np.arange(5.0), np.zeros((5, 3)), np.zeros((5, 3)))
        figure = time_series.force_figure(
            still, SumsOfSquares(np.zeros(3), np.zeros(3)), name="still"
        )
        texts = [text.get_text() for text in figure.axes[0].texts]
        assert texts == ["error\n-\nnoise\n-"]


def test_legend_and_title_lie_above_the_data():
    traces = small_traces()
    figure = time_series.force_figure(traces, floor_of(traces, 0.1), name="run")
    figure.canvas.draw()
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert legend.get_window_extent().y0 > figure.axes[0].get_window_extent().y1
    title = figure.axes[0]._left_title.get_window_extent()  # type: ignore[attr-defined]
    assert title.y0 >= legend.get_window_extent().y1 - 1
    assert title.y1 <= figure.bbox.y1


def test_free_run_is_shown_in_metres_a_second():
    traces = small_traces()
    length = PAPER.geometry.L
    shown = of_platform(PAPER.geometry)
    figure = time_series.free_run_figure(
        traces, floor_of(traces, 0.1), name="run", quantities=shown
    )
    for k, scale in enumerate((length, length, 1.0)):
        _, shown = drawn(figure.axes[2 * k], "free run of the model")
        np.testing.assert_allclose(shown, scale * traces.predicted[:, k])
        _, shown = drawn(figure.axes[2 * k], "measured")
        np.testing.assert_allclose(shown, scale * traces.measured[:, k])
    units = [axes.get_ylabel().split("  ")[1] for axes in figure.axes[::2]]
    assert units == ["[m/s]", "[m/s]", "[rad/s]"]


def test_tracking_error_is_relative_to_the_reference():
    time = np.linspace(0.0, 10.0, 100)
    reference = np.column_stack([np.sin(time)] * 3)
    figure = time_series.tracking_figure(time, 0.75 * reference, reference, name="run")
    for k in range(3):
        _, shown = drawn(figure.axes[2 * k], "reference")
        np.testing.assert_array_equal(shown, reference[:, k])
        (note,) = figure.axes[2 * k].texts
        assert note.get_text() == "error\n25 %"


class TestMotionFigure:
    TIME = np.linspace(0.0, 10.0, 50)
    TWIST = np.column_stack([np.sin(TIME), np.cos(TIME), 0.5 * np.sin(TIME)])

    def test_ideal_motion_is_drawn_where_it_is_known(self):
        ideal = self.TWIST + [0.0, 0.1, 0.0]
        figure = time_series.motion_figure(self.TIME, self.TWIST, ideal, name="run")
        for k, axes in enumerate(figure.axes):
            np.testing.assert_array_equal(drawn(axes, "measured")[1], self.TWIST[:, k])
            np.testing.assert_array_equal(drawn(axes, "ideal motion")[1], ideal[:, k])
        assert figure.axes[1].texts[0].get_text() == "rms off\n0.1\nm/s"

    def test_measured_alone_otherwise(self):
        figure = time_series.motion_figure(self.TIME, self.TWIST, None, name="run")
        assert legend_of(figure) == ["measured"]

    def test_stretches_are_named_and_parted(self):
        stretches = [("I", 0.0, 4.0), ("III", 4.4, 10.0)]
        figure = time_series.motion_figure(
            self.TIME, self.TWIST, None, name="run", stretches=stretches
        )
        names = {text.get_text(): text.xy[0] for text in figure.axes[0].texts}  # type: ignore
        assert names == {"I": 2.0, "III": pytest.approx(7.2)}
        for axes in figure.axes:
            borders = [line for line in axes.get_lines() if len(np.asarray(line.get_xdata())) == 2]
            assert [np.asarray(line.get_xdata())[0] for line in borders] == [pytest.approx(4.2)]


class TestEstimatesFigure:
    def course(self) -> EstimateHistory:
        time = np.linspace(0.0, 10.0, 100)
        value = np.column_stack([3.0 + np.exp(-time), -2.0 - np.exp(-time)])
        # Before the motion that shows a parameter its band is as wide as the prior.
        std = np.where(time < 4.0, 1e3, 0.1)[:, None] * np.ones(2)
        return EstimateHistory(time, value, std)

    def test_lines_bands_and_labels(self):
        course = self.course()
        figure = time_series.estimates_figure(
            course, ["$a$  [kg]", "$b$  [m]"], np.array([3.0, -2.0]), truth=np.array([3.1, -2.1])
        )
        assert [axes.get_ylabel() for axes in figure.axes] == ["$a$  [kg]", "$b$  [m]"]
        for k, axes in enumerate(figure.axes):
            np.testing.assert_array_equal(drawn(axes, "recursive estimate")[1], course.theta[:, k])
            assert set(drawn(axes, "batch estimate")[1]) == {[3.0, -2.0][k]}
            assert set(drawn(axes, "true value")[1]) == {[3.1, -2.1][k]}
            (band,) = axes.collections
            edge = np.asarray(band.get_paths()[0].vertices)[:, 1]
            final = course.theta[-1, k] + np.array([-1.96, 1.96]) * 0.1
            assert np.isclose(edge[:, None], final).any(axis=0).all()

    def test_the_open_start_does_not_dwarf_the_end(self):
        course = self.course()
        figure = time_series.estimates_figure(course, ["$a$", "$b$"], np.array([3.0, -2.0]))
        low, high = figure.axes[0].get_ylim()
        late = course.theta[50:, 0]
        assert low < late.min() - 0.196 and late.max() + 0.196 < high
        assert high - low < 1.0

    def test_any_number_of_parameters(self):
        time = np.arange(4.0)
        for size in (1, 8):
            course = EstimateHistory(time, np.ones((4, size)), np.ones((4, size)))
            figure = time_series.estimates_figure(course, ["$p$"] * size, np.ones(size))
            assert sum(axes.axison for axes in figure.axes) == size
            figure.canvas.draw()


def test_stretches_show_the_comparison_s_numbers(compared: Comparison):
    (item,) = compared.logs
    worst = compared.worst()
    stretches = compared.stretches(item)
    figure = failures.stretch_figure(stretches, worst, item.force_floor, name="run")
    for k, axis in enumerate(("VX", "VY", "W")):
        axes = figure.axes[k]
        rows = [row for row in stretches if row["axis"] == axis]
        bars = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
        assert [bar.get_height() for bar in bars] == pytest.approx(
            [100 * row["force_error"] for row in rows]
        )
        marked = {
            row["from"]
            for row, bar in zip(rows, bars, strict=True)
            if to_hex(bar.get_facecolor()) == style.WORST
        }
        assert marked == {row["from"] for row in worst if row["axis"] == axis}
        assert drawn(axes, "noise floor")[1][0] == pytest.approx(100 * item.force_floor.by_axis[k])


class TestResidualFigure:
    def compared(self) -> Comparison:
        planted = (("wheel_coulomb_friction", (("torque", 0.25),)),)
        return compare(PAPER, [recording("calibration", planted, rate=50.0)])

    def test_the_strongest_variables_are_drawn_with_their_shares(self, tmp_path: Path):
        result = self.compared()
        paths = figures.plot_comparison(result, tmp_path)
        assert paths[-1].name == "residual.png"
        curves = result.where.curve("twist")
        figure = failures.residual_figure([(curve.label, curve) for curve in curves])
        panels = np.array(figure.axes).reshape(3, 3)
        for row, curve in zip(panels, curves, strict=True):
            assert row[0].get_ylabel() == curve.label
            for k, axes in enumerate(row):
                (line,) = [x for x in axes.get_lines() if len(np.asarray(x.get_xdata())) > 2]
                np.testing.assert_array_equal(line.get_ydata(), curve.force[:, k])
                assert f"[{curve.unit}]" in axes.get_xlabel()

    def test_nothing_is_drawn_where_nothing_leads(self, compared: Comparison, tmp_path: Path):
        assert compared.where.leading == ()
        names = [path.name for path in figures.plot_comparison(compared, tmp_path)]
        assert "residual.png" not in names


class TestAxis:
    """One axis is drawn with its own symbols and units, a panel of each kind."""

    @pytest.mark.parametrize(("turns", "units"), [(False, ("N", "m/s")), (True, ("N m", "rad/s"))])
    def test_units_and_panels(self, turns: bool, units: tuple[str, str]):
        axis, theta = planted(STAGE, "spring", turns=turns)
        log = log_of(axis, theta, 100.0, noise=0.002)
        base = base_axis_model([log], unit="rad" if turns else "m")
        fitted = identify([log], start=base)
        found = dict(figures.figures_of_identification(fitted, [log]))
        force = found["forces_drive"].axes
        assert len(force) == 2 and force[0].get_ylabel().endswith(f"[{units[0]}]")
        (motion,) = found["motion_drive"].axes
        assert motion.get_ylabel().endswith(f"[{units[1]}]")
        _, shown = drawn(motion, "measured")
        assert (shown.min(), shown.max()) == (log.velocity.min(), log.velocity.max())
        names = [axes.get_ylabel().split("  ")[0] for axes in found["estimates"].axes]
        assert names == ["inertia", "viscous", "coulomb", "offset"]
        compared = dict(figures.figures_of_comparison(compare(fitted.model, [log])))
        assert compared["free_run_drive"].axes[0].get_ylabel().endswith(f"[{units[1]}]")
        assert len(compared["where_drive"].axes) == 1
        first = compared["residual"].axes[0]
        assert first.get_title(loc="left").endswith(f"[{units[0]}]")
        assert first.get_xlabel() == f"position  [{'rad' if turns else 'm'}]"


def test_the_error_falls_in_the_figure_as_in_the_steps():
    steps = [(None, 0.14, 0.18), ("floor_tilt", 0.015, float("nan"))]
    figure = failures.fall_figure(steps, {"force_error": 0.0145, "velocity_error": 0.012})
    force, velocity = figure.axes
    widths = [bar.get_width() for bar in force.patches if isinstance(bar, Rectangle)]
    assert widths == pytest.approx([14.0, 1.5])
    (floor,) = force.get_lines()
    assert np.asarray(floor.get_xdata())[0] == pytest.approx(1.45)
    assert [text.get_text() for text in velocity.texts] == ["18 %", "-"]
    names = [label.get_text() for label in force.get_yticklabels()]
    assert names == ["the model, refitted", "with floor_tilt"]
    figure.canvas.draw()


def test_a_proposed_law_is_the_last_bar_and_marked():
    steps, floor = [(None, 0.14, 0.18)], {"force_error": 0.0145, "velocity_error": 0.012}
    law = ("dry_nap", 0.015, 0.02)
    figure = failures.fall_figure(steps, floor, law)
    bars = [bar for bar in figure.axes[0].patches if isinstance(bar, Rectangle)]
    assert [bar.get_width() for bar in bars] == pytest.approx([14.0, 1.5])
    assert bars[0].get_hatch() is None and bars[1].get_hatch()
    last = figure.axes[0].get_yticklabels()[-1].get_text()
    assert last == "with dry_nap\n(proposed)"
    figure.canvas.draw()
    chart = single_charts.errors_chart(steps, floor, law)
    panels: Any = chart.figure.data
    for bars, widths in zip(panels, ([14.0, 1.5], [18.0, 2.0]), strict=True):
        assert list(bars.x) == pytest.approx(widths)
        assert bars.y[-1] == "+ dry_nap<br>(proposed)"
        assert list(bars.marker.pattern.shape) == ["", "/"]
    assert "not confirmed" in chart.title
    assert "not confirmed" not in single_charts.errors_chart(steps, floor).title


def test_a_name_with_dollars_is_no_formula():
    traces = small_traces()
    figure = time_series.force_figure(
        traces, floor_of(traces, 0.1), name=r"cost $\bad$ 5$", stretches=[("$^", 0.0, 2.0)]
    )
    figure.canvas.draw()


class TestThinning:
    def test_short_lines_stay_as_they_are(self):
        time, values = np.arange(50.0), np.random.default_rng(0).normal(size=50)
        for kept, given in zip(style.thin(time, values), (time, values), strict=True):
            assert kept is given

    def test_long_lines_keep_ends_and_every_extreme(self):
        time = np.arange(100_000.0)
        values = np.sin(1e-3 * time)
        values[31_234], values[77_777] = 9.0, -7.0
        kept_time, kept = style.thin(time, values)
        assert len(kept) <= 2 * style.BINS + 2
        assert (np.diff(kept_time) > 0).all()
        assert kept_time[[0, -1]].tolist() == [0.0, 99_999.0]
        assert kept_time[kept.argmax()] == 31_234 and kept_time[kept.argmin()] == 77_777
        np.testing.assert_array_equal(kept, values[kept_time.astype(int)])


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0123, "1.2 %"), (0.01, "1.0 %"), (0.00012, "0.012 %"), (0.12, "12 %"), (1.1, "110 %"),
     (float("nan"), "-"), (float("inf"), "-")],
)  # fmt: skip
def test_percent(value: float, text: str):
    assert style.percent(value) == text


class TestReferences:
    """A log's reference is what `youbot record` wrote down beside it."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        motion = tmp_path / "motion.json"
        short = multisine(np.random.default_rng(3), duration=12.0, tones=3, name="multisine_s")
        motion.write_text(json.dumps(short.to_dict()))
        out = tmp_path / "runs"
        assert main(["record", str(out), "--motions", str(motion), "--rate", "50"]) == 0
        return out

    def test_recorded_logs_know_their_motion(self, folder: Path):
        log = read_log(folder / "multisine_s.csv")
        motion = recorded_motion(log)
        assert motion is not None
        twist = PAPER.geometry.body_twist(log.velocity)
        reference = motion.twist(log.time)
        # The stock loop is poor, but it does follow.
        assert np.corrcoef(twist[:, 0], reference[:, 0])[0, 1] > 0.7

    def test_a_log_that_was_changed_since_does_not(self, folder: Path):
        log = read_log(folder / "multisine_s.csv")
        write_log(folder / "multisine_s.csv", dataclasses.replace(log, velocity=1.1 * log.velocity))
        assert recorded_motion(read_log(folder / "multisine_s.csv")) is None

    @pytest.mark.parametrize(
        "content",
        ["", "[]", "{}", '{"logs": 3}', "\x00", '{"logs": {"multisine_s.csv": {}}}', "[" * 10_000],
    )
    def test_nor_does_a_strange_record(self, folder: Path, content: str):
        (folder / "record.json").write_text(content)
        assert recorded_motion(read_log(folder / "multisine_s.csv")) is None

    def test_nor_a_log_in_memory(self, calibration: Log):
        assert recorded_motion(calibration) is None

    def test_the_plots_show_it(self, folder: Path, fitted: Identification):
        log = read_log(folder / "multisine_s.csv")
        paths = figures.plot_comparison(compare(fitted.model, [log]), folder)
        assert [path.name for path in paths] == [
            "free_run_multisine_s.png",
            "where_multisine_s.png",
            "tracking_multisine_s.png",
        ]


class TestFiles:
    def test_of_an_identification(self, fitted: Identification, tmp_path: Path):
        folder = tmp_path / "deep" / "folder"
        paths = figures.plot_identification(fitted, folder, truth=PAPER)
        names = ["forces_calibration.png", "motion_calibration.png", "estimates.png"]
        assert [path.name for path in paths] == names
        written = [*names, *(name.replace(".png", ".svg") for name in names)]
        assert sorted(path.name for path in folder.iterdir()) == sorted(written), "and no leftovers"
        for path in paths:
            with Image.open(path) as picture:
                assert picture.format == "PNG"
                assert picture.width == 1000
                assert 500 <= picture.height <= 1000
                assert len(picture.convert("RGB").getcolors(10**6) or []) > 10, "not empty"
            assert path.stat().st_size < 250_000
            drawing = ElementTree.parse(path.with_suffix(".svg")).getroot()
            assert drawing.tag == "{http://www.w3.org/2000/svg}svg"
            assert path.with_suffix(".svg").stat().st_size < 3_000_000

    def test_of_an_identification_without_a_course(self, fitted: Identification, tmp_path: Path):
        bare = dataclasses.replace(fitted, course=None)
        names = [path.name for path in figures.plot_identification(bare, tmp_path)]
        assert "estimates.png" not in names

    def test_the_same_result_gives_the_same_bytes(self, compared: Comparison, tmp_path: Path):
        first, again = (figures.plot_comparison(compared, tmp_path / x) for x in "ab")
        assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]
        for path, other in zip(first, again, strict=True):
            assert path.with_suffix(".svg").read_bytes() == other.with_suffix(".svg").read_bytes()

    def test_forces_in_the_figure_are_those_of_the_fit(
        self, fitted: Identification, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ):
        seen = {}

        def spy(traces: Traces, floor: SumsOfSquares, **_: object) -> Figure:
            seen.update(traces=traces, floor=floor)
            raise InputError("seen enough")

        monkeypatch.setattr(time_series, "force_figure", spy)
        with pytest.raises(InputError, match="seen enough"):
            figures.plot_identification(fitted, tmp_path)
        (samples,) = fitted.samples
        expected = force_traces(fitted.mechanism, fitted.fit.theta, samples)
        np.testing.assert_array_equal(seen["traces"].predicted, expected.predicted)
        assert SumsOfSquares.of(seen["traces"]).ratio == pytest.approx(
            fitted.model.errors["force_error"]
        )
        (floor,) = fitted.floor.force
        np.testing.assert_allclose(seen["floor"].residual, floor.residual)

    def test_recognised_motions_are_marked(
        self, fitted: Identification, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ):
        seen = []

        def spy(*_: object, stretches: list[time_series.Stretch], **__: object) -> Figure:
            seen.extend(stretches)
            raise InputError("seen enough")

        monkeypatch.setattr(time_series, "force_figure", spy)
        with pytest.raises(InputError, match="seen enough"):
            figures.plot_identification(fitted, tmp_path)
        assert [name for name, _, _ in seen] == ["I", "III", "II", "IV"]

    def test_a_failed_write_leaves_the_old_file(
        self, compared: Comparison, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ):
        target = tmp_path / "free_run_multisine_s.png"
        target.write_bytes(b"old")

        def fail(*_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("identification.logs.writing.os.replace", fail)
        with pytest.raises(InputError, match="No space left"):
            figures.plot_comparison(compared, tmp_path)
        assert target.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [target]

    def test_a_file_where_the_folder_should_be(self, compared: Comparison, tmp_path: Path):
        (tmp_path / "plots").write_text("")
        with pytest.raises(InputError, match="plots: cannot be made a folder"):
            figures.plot_comparison(compared, tmp_path / "plots")


def test_the_user_s_matplotlib_stays_as_it_was(tmp_path: Path):
    """Neither pyplot nor a backend is loaded, and settings such as a dark style survive."""
    code = (
        "import sys, numpy as np, matplotlib as mpl;"
        "mpl.rcParams['axes.facecolor'] = 'black'; before = dict(mpl.rcParams.copy());"
        "from identification.figures import style, time_series; from pathlib import Path;"
        "t = np.arange(9.0); v = np.ones((9, 3));"
        "f = time_series.motion_figure(t, v, None, name='x');"
        "style.write_figure(Path(sys.argv[1]), f);"
        "assert mpl.colors.same_color(f.axes[0].get_facecolor(), 'white');"
        "assert dict(mpl.rcParams.copy()) == before;"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    target = str(tmp_path / "x.png")
    run = subprocess.run([sys.executable, "-c", code, target], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_a_missing_matplotlib_is_one_clear_line(
    compared: Comparison, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=r"pip install 'youbot\[plots\]'") as caught:
        figures.plot_comparison(compared, tmp_path / "plots")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "plots").exists()


def test_a_backend_that_is_none_draws_all_the_same():
    """It belongs to pyplot, which is not used, but a wrong name stops matplotlib's import."""
    program = (
        "from identification.figures.style import matplotlib, new_figure, png; import os\n"
        "matplotlib(); print(len(png(new_figure(2.0))) > 100, os.environ['MPLBACKEND'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"MPLBACKEND": "nonsense", "PYTHONPATH": str(Path(__file__).parents[3])},
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.stdout.split() == ["True", "nonsense"], done.stderr
