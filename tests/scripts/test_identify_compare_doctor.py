"""The commands identify, compare and doctor: what they print, write and refuse."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.recording import record
from identification.logs.log import AXIS, Log
from identification.logs.reading import read_log, write_log
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from tests.identification.recordings import recording
from youbot_env.model.model import BASE_UNITS
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine
from youbot_scripts.cli import main
from youbot_scripts.shared.tables import with_std

PAPER = load_model("paper")
AXES = {"VX", "VY", "W"}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with calibration.csv, and two multisines a.csv.gz and b.csv."""
    folder = tmp_path_factory.mktemp("runs")
    write_log(folder / "calibration.csv", recording("calibration", rate=50.0))
    for seed, name in enumerate(("a.csv.gz", "b.csv"), 3):
        motion = multisine(np.random.default_rng(seed), duration=20.0, tones=3)
        write_log(folder / name, record(PAPER, [motion], rate=50.0, seed=seed)[0])
    return folder


@pytest.fixture(scope="module")
def model(logs: Path) -> Path:
    """Model file that `identify` fitted to calibration.csv."""
    path = logs.parent / "model.json"
    assert main(["identify", str(logs / "calibration.csv"), "-o", str(path)]) == 0
    return path


def run_json(arguments: Sequence[object], folder: Path) -> dict[str, Any]:
    """What a command writes with --json, when it succeeds."""
    target = folder / "result.json"
    assert main([*map(str, arguments), "--json", str(target)]) == 0
    return json.loads(target.read_text())


def refused(arguments: Sequence[object], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line with which a command refuses its input."""
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 2
    line = capsys.readouterr().err
    assert line.startswith("youbot: error: ") and line.count("\n") == 1, line
    return line


class TestIdentify:
    def test_prints_what_it_writes(self, logs: Path, tmp_path: Path, capsys):
        target = tmp_path / "model.json"
        arguments = ["identify", logs / "calibration.csv", "-o", target]
        found = run_json(arguments, tmp_path)
        out = capsys.readouterr().out
        loaded = load_model(target)
        assert set(found["parameters"]) == set(BASE_UNITS)
        for name, unit in BASE_UNITS.items():
            entry = found["parameters"][name]
            estimate = loaded.parameters[name]
            assert (entry["value"], entry["std"]) == (estimate.value, estimate.std)
            assert entry["unit"] == unit
            (row,) = [line for line in out.splitlines() if line.startswith(f" {name} ")]
            assert with_std(entry["value"], entry["std"]) in row
            shown = [float(end) for end in re.split(r"  +", row.strip())[2].split(" ... ")]
            assert shown == pytest.approx(entry["interval"], abs=0.1 * entry["std"])
            assert row.rstrip().endswith(unit)
        assert f"model written to {target}" in out
        assert "gyration radius" not in out, "that of the paper's platform is no news from a log"
        for motion in ("I", "II", "III", "IV"):
            assert any(line.split()[:2] == ["calibration", motion] for line in out.splitlines())

    def test_json_holds_observability_errors_and_provenance(self, logs: Path, tmp_path: Path):
        found = run_json(["identify", logs / "calibration.csv", "--seed", "3"], tmp_path)
        assert found["observability"]["total"]["rank"] == 7
        assert {part["kind"] for part in found["observability"]["parts"]} >= {"I", "II", "III"}
        assert 0 < found["errors"]["noise_floor"]["force_error"] < 0.05
        assert found["logs"][0]["name"] == "calibration" and len(found["logs"][0]["sha256"]) == 64
        assert (found["seed"], found["version"]) == (3, version("youbot"))

    def test_recovers_the_plant(self, logs: Path, tmp_path: Path):
        found = run_json(["identify", logs / "calibration.csv"], tmp_path)["parameters"]
        for name, value in PAPER.values.items():
            assert abs(found[name]["value"] - value) < 4 * found[name]["std"], name

    @pytest.mark.parametrize("option", ["--robust", "--output-error"])
    def test_options_change_the_method_not_the_answer(
        self, logs: Path, tmp_path: Path, model: Path, option: str
    ):
        found = run_json(["identify", logs / "calibration.csv", option], tmp_path)
        plain = load_model(model)
        for name, entry in found["parameters"].items():
            estimate = plain.parameters[name]
            assert entry["value"] != estimate.value
            assert abs(entry["value"] - estimate.value) < 3 * (estimate.std or 0), name
        assert ("velocity_error" in found["errors"]) == (option == "--output-error")

    def test_geometry_is_the_user_s(self, logs: Path, tmp_path: Path):
        g = PAPER.geometry
        lengths = {"l": g.l, "h": g.h, "R": 0.05, "r": g.r, "m1": g.m1}
        (tmp_path / "wide.json").write_text(json.dumps(lengths))
        target = tmp_path / "model.json"
        arguments = ["identify", logs / "calibration.csv", "-o", target]
        assert main([*map(str, arguments), "--geometry", str(tmp_path / "wide.json")]) == 0
        found = load_model(target)
        assert found.geometry.R == 0.05
        # What the wheels feel of the mass, m0 R^2 + 4 I1, is the same whatever R is said to be.
        felt = [
            model.values["m0"] * model.geometry.R**2 + 4 * model.values["I1"]
            for model in (found, PAPER)
        ]
        assert felt[0] == pytest.approx(felt[1], rel=0.01)
        # compare takes the model's own geometry, or another
        b = logs / "b.csv"
        own = run_json(["compare", target, b], tmp_path)["total"]["velocity_error"]
        other = run_json(["compare", target, b, "--geometry", "paper"], tmp_path)
        assert 2 * own < other["total"]["velocity_error"]

    def test_a_model_s_effects_are_fitted_too(self, logs: Path, tmp_path: Path):
        from youbot_env.model.model_file import save_model

        save_model(tmp_path / "tilt.json", PAPER.with_effect("floor_tilt", tilt_x=0.0, tilt_y=0.0))
        arguments = ["identify", logs / "calibration.csv", "--model", tmp_path / "tilt.json"]
        found = run_json(arguments, tmp_path)["parameters"]
        for name in ("floor_tilt.tilt_x", "floor_tilt.tilt_y"):
            assert abs(found[name]["value"]) < 4 * found[name]["std"], "the floor is level"

    def test_blind_logs_are_refused_with_the_motion_that_would_show_it(
        self, tmp_path: Path, capsys
    ):
        write_log(tmp_path / "circles.csv", recording("III", rate=50.0))
        line = refused(["identify", tmp_path / "circles.csv", "-o", tmp_path / "m.json"], capsys)
        assert "cannot show" in line and "motion I" in line
        assert not (tmp_path / "m.json").exists()

    def test_plots(self, logs: Path, tmp_path: Path, capsys):
        folder = tmp_path / "plots"
        assert main(["identify", str(logs / "calibration.csv"), "--plots", str(folder)]) == 0
        out = capsys.readouterr().out.replace("\n", "")
        names = {path.name for path in folder.glob("*.png")}
        assert names == {path.with_suffix(".png").name for path in folder.glob("*.svg")}
        assert names == {"forces_calibration.png", "motion_calibration.png", "estimates.png"}
        for name in names:
            assert f"plot written to {folder / name}" in out

    def test_json_alone_on_standard_output(self, logs: Path, capsys):
        assert main(["identify", str(logs / "calibration.csv"), "--json", "-"]) == 0
        printed = capsys.readouterr()
        assert set(json.loads(printed.out)["parameters"]) == set(BASE_UNITS)
        assert "Parameters" in printed.err


class TestSetAside:
    """One log of several that cannot be used, and the misfit, in terminal and JSON."""

    @pytest.fixture
    def broken(self, logs: Path) -> Path:
        path = logs.parent / "broken.csv"
        path.write_text("time,velocity_fl\n0.0,1.0\n")
        return path

    @pytest.mark.parametrize("command", ["identify", "compare"])
    def test_it_is_named_with_its_reason(
        self, command: str, logs: Path, model: Path, broken: Path, tmp_path: Path, capsys
    ):
        start = ["compare", model] if command == "compare" else ["identify"]
        found = run_json([*start, broken, logs / "calibration.csv"], tmp_path)
        (aside,) = found["set_aside"]
        assert aside["log"] == str(broken) and "missing" in aside["reason"]
        assert f"warning: {broken} set aside: " in capsys.readouterr().out
        assert str(broken) not in aside["reason"]

    def test_strict_refuses_all_and_none_left_is_the_first_s_reason(
        self, logs: Path, broken: Path, tmp_path: Path, capsys
    ):
        line = refused(["identify", logs / "calibration.csv", broken, "--strict"], capsys)
        assert f"{broken}: " in line
        (tmp_path / "empty.csv").write_text("")
        assert f"{broken}: " in refused(["identify", broken, tmp_path / "empty.csv"], capsys)

    def test_two_logs_of_one_name_are_refused_as_ever(self, logs: Path, tmp_path: Path, capsys):
        again = tmp_path / "calibration.csv"
        again.write_bytes((logs / "calibration.csv").read_bytes())
        line = refused(["identify", logs / "calibration.csv", again], capsys)
        assert "has the name of" in line


def test_a_misfit_is_the_first_line_without_intervals_and_with_what_to_type(tmp_path: Path, capsys):
    slope = ("floor_tilt", (("tilt_x", 0.0), ("tilt_y", -0.04)))
    path, target = tmp_path / "slope.csv", tmp_path / "model.json"
    write_log(path, recording(effects=(slope,), rate=50.0))
    found = run_json(["identify", path, "-o", target], tmp_path)
    out = capsys.readouterr().out
    command = f"youbot diagnose {target} {path}"
    assert out.startswith("warning: the force error is ") and command in out.splitlines()[0]
    assert found["misfit"] == found["warnings"][0] and command in found["misfit"]
    assert all(entry["interval"] is None for entry in found["parameters"].values())
    assert "±" not in out and load_model(target).parameters["m0"].std
    found = run_json(["compare", target, path], tmp_path)
    assert command in found["misfit"]
    assert capsys.readouterr().out.startswith("warning: the force error is ")


class TestCompare:
    def test_json_has_the_fixed_keys(self, logs: Path, model: Path, tmp_path: Path):
        found = run_json(["compare", model, logs / "a.csv.gz", logs / "b.csv"], tmp_path)
        assert set(found) >= {"logs", "total", "noise_floor", "where", "stretches"}
        assert set(found["logs"]) == {"a", "b"}
        both = {"force_error", "velocity_error"}
        assert set(found["total"]) == both <= set(found["noise_floor"])
        assert found["misfit"] is None and found["set_aside"] == []
        for entry in found["logs"].values():
            assert set(entry) >= {*both, "seen_in_fit", "slip"}
            assert entry["seen_in_fit"] is False
            for kind in both:
                assert 0 < entry[kind] < 0.1
                assert set(entry[f"{kind}_by_axis"]) == AXES
        for kind, keys in (("where", {"variable", "share"}), ("stretches", {"log", "axis"})):
            assert found[kind] and all(set(row) >= keys for row in found[kind])
            shares = [row["share"] for row in found[kind]]
            assert shares == sorted(shares, reverse=True)

    def test_tables_show_the_errors(self, logs: Path, model: Path, tmp_path: Path, capsys):
        found = run_json(["compare", model, logs / "b.csv"], tmp_path)
        out = capsys.readouterr().out
        for kind in ("force_error", "velocity_error"):
            entry = found["logs"]["b"]
            for value in (entry[kind], *entry[f"{kind}_by_axis"].values()):
                assert f"{100 * value:.2f} %" in out

    def test_logs_of_the_fit_are_marked_and_left_out(
        self, logs: Path, model: Path, tmp_path: Path, capsys
    ):
        calibration, b = logs / "calibration.csv", logs / "b.csv"
        found = run_json(["compare", model, calibration, b], tmp_path)
        assert "calibration (fitted on)" in capsys.readouterr().out
        seen = {name: entry["seen_in_fit"] for name, entry in found["logs"].items()}
        assert seen == {"calibration": True, "b": False}
        for kind in ("force_error", "velocity_error"):
            assert found["total"][kind] == found["logs"]["b"][kind]

    @pytest.mark.slow
    def test_unless_all_are(self, logs: Path, model: Path, tmp_path: Path):
        found = run_json(["compare", model, logs / "calibration.csv"], tmp_path)
        for kind in ("force_error", "velocity_error"):
            assert found["total"][kind] == found["logs"]["calibration"][kind]

    def test_seen_goes_by_content_not_by_name(self, logs: Path, model: Path, tmp_path: Path):
        (tmp_path / "b.csv").write_bytes((logs / "calibration.csv").read_bytes())
        found = run_json(["compare", model, tmp_path / "b.csv"], tmp_path)
        assert found["logs"]["b"]["seen_in_fit"] is True

    def test_predictions_have_the_log_s_rows_and_times(
        self, logs: Path, model: Path, tmp_path: Path, capsys
    ):
        folder = tmp_path / "predicted"
        arguments = ["compare", model, logs / "a.csv.gz", logs / "b.csv", "--predictions", folder]
        assert main([*map(str, arguments)]) == 0
        assert sorted(path.name for path in folder.iterdir()) == ["a.csv", "b.csv"]
        log = read_log(logs / "b.csv")
        rows = (folder / "b.csv").read_text().splitlines()
        assert rows[0] == "time,velocity_fl,velocity_fr,velocity_bl,velocity_br"
        values = np.array([row.split(",") for row in rows[1:]], float)
        source = [line.split(",")[0] for line in (logs / "b.csv").read_text().splitlines()[1:]]
        np.testing.assert_array_equal(values[:, 0], np.array(source, float))
        error = values[:, 1:] - log.velocity
        assert np.sqrt(np.mean(error**2) / np.mean(log.velocity**2)) < 0.05

    def test_predictions_fill_rows_that_were_repaired(
        self, logs: Path, model: Path, tmp_path: Path
    ):
        lines = (logs / "b.csv").read_text().splitlines()
        cells = lines[300].split(",")
        lines[300] = ",".join([cells[0], "nan", *cells[2:]])
        (tmp_path / "holes.csv").write_text("\n".join(lines) + "\n")
        arguments = ["compare", model, tmp_path / "holes.csv", "--predictions", tmp_path / "out"]
        assert main([*map(str, arguments)]) == 0
        rows = (tmp_path / "out" / "holes.csv").read_text().splitlines()
        assert len(rows) == len(lines)
        assert np.isfinite(np.array(rows[300].split(","), float)).all()

    @pytest.mark.parametrize("command", ["identify", "compare"])
    def test_two_logs_of_one_stem_are_refused(
        self, logs: Path, model: Path, tmp_path: Path, capsys, command: str
    ):
        (tmp_path / "b.csv").write_bytes((logs / "b.csv").read_bytes())
        folder = tmp_path / "predicted"
        arguments: list[object] = [command, logs / "b.csv", tmp_path / "b.csv"]
        if command == "compare":
            arguments[1:1] = [model]
            arguments += ["--predictions", folder]
        line = refused(arguments, capsys)
        assert str(logs / "b.csv") in line and str(tmp_path / "b.csv") in line
        assert not folder.exists()

    def test_plots(self, logs: Path, model: Path, tmp_path: Path):
        folder = tmp_path / "plots"
        assert main(["compare", str(model), str(logs / "b.csv"), "--plots", str(folder)]) == 0
        names = {f"{name}.{kind}" for name in ("free_run_b", "where_b") for kind in ("png", "svg")}
        assert {path.name for path in folder.iterdir()} == names

    def test_a_shipped_model_goes_by_its_name(self, logs: Path, tmp_path: Path):
        found = run_json(["compare", "paper", logs / "b.csv"], tmp_path)
        ratio = found["total"]["velocity_error"] / found["noise_floor"]["velocity_error"]
        assert ratio == pytest.approx(1.0, abs=0.35), "the plant itself leaves noise alone"


class TestDoctor:
    def test_reports_a_sound_log(self, logs: Path, tmp_path: Path, capsys):
        path = logs / "calibration.csv"
        report = run_json(["doctor", path], tmp_path)["logs"][str(path)]
        out = capsys.readouterr().out
        assert report["usable"] is True
        assert (report["rows"], report["rate"]) == (7000, pytest.approx(50.0))
        assert report["noise"]["speed"] == pytest.approx(0.01, rel=0.2)
        assert report["noise"]["torque"] == pytest.approx(0.03, rel=0.2)
        assert report["shows"]["rank"] == 7 and report["shows"]["blind"] == []
        assert "7000 rows, 140.0 s at 50 Hz" in out
        assert "shows all seven parameters" in out

    def test_names_what_a_log_cannot_show_and_the_motion_that_would(self, tmp_path: Path, capsys):
        write_log(tmp_path / "circles.csv", recording("III", rate=50.0))
        assert main(["doctor", str(tmp_path / "circles.csv")]) == 0
        out = capsys.readouterr().out
        assert "cannot show" in out and "motion I" in out

    def test_reports_all_logs_though_one_is_broken(self, logs: Path, tmp_path: Path, capsys):
        (tmp_path / "broken.csv").write_text("time,velocity_fl\n0,1\n")
        target = tmp_path / "checks.json"
        arguments = ["doctor", tmp_path / "broken.csv", logs / "b.csv", "--json", target]
        line = refused(arguments, capsys)
        assert "1 of 2 logs" in line and "broken.csv" in line
        reports = json.loads(target.read_text())["logs"]
        assert [report["usable"] for report in reports.values()] == [False, True]
        assert [f["level"] for f in reports[str(tmp_path / "broken.csv")]["findings"]] == ["error"]

    def test_tells_of_repairs(self, logs: Path, tmp_path: Path, capsys):
        log = read_log(logs / "b.csv")
        velocity = np.array(log.velocity)
        velocity[200, 1] += 8.0
        write_log(tmp_path / "spike.csv", replace(log, velocity=velocity))
        report = run_json(["doctor", tmp_path / "spike.csv"], tmp_path)["logs"]
        (report,) = report.values()
        repaired = [f for f in report["findings"] if f["level"] == "repaired"]
        assert [(f["row"], f["column"]) for f in repaired] == [(202, "velocity_fr")]
        out = " ".join(capsys.readouterr().out.split())
        assert "repaired: row 202: column velocity_fr" in out

    def test_a_log_of_one_axis(self, tmp_path: Path, capsys):
        axis, theta = planted(STAGE)
        path = tmp_path / "drive.csv"
        write_log(path, log_of(axis, theta, 100.0, noise=0.002))
        arguments = ["doctor", path, "--mechanism", "axis", "--unit", "m"]
        (report,) = run_json(arguments, tmp_path)["logs"].values()
        out = capsys.readouterr().out
        assert report["usable"] and report["shows"]["rank"] == 4
        assert report["units"] == {"speed": "m/s", "torque": "N"}
        # The log's noise is 0.2 % of the rms speed, 0.1 m/s.
        assert report["noise"]["speed"] == pytest.approx(2e-4, rel=0.2)
        assert "4000 rows, 40.0 s at 100 Hz" in out and "shows all four parameters" in out

    def test_what_a_log_of_one_axis_cannot_show(self, tmp_path: Path, capsys):
        time = np.arange(0, 20, 0.01)
        speed = np.where(np.sin(time) > 0, 0.1, -0.1)[:, None]
        noise = 1e-6 * np.random.default_rng(0).standard_normal(speed.shape)
        write_log(tmp_path / "flat.csv", Log("flat", AXIS, time, speed + noise, 200 * speed))
        assert main(["doctor", str(tmp_path / "flat.csv"), "--mechanism", "axis"]) == 0
        out = " ".join(capsys.readouterr().out.split())
        assert "cannot show" in out and "several speeds" in out

    def test_a_log_that_is_of_something_else(self, logs: Path, tmp_path: Path, capsys):
        line = refused(["doctor", logs / "b.csv", "--mechanism", "axis"], capsys)
        assert "b.csv" in line


class TestRefusals:
    """Status 2, one line that names the place, and nothing half-written."""

    @pytest.mark.parametrize("command", ["identify", "compare", "doctor"])
    def test_missing_file(self, command: str, model: Path, tmp_path: Path, capsys):
        arguments = [command, *([model] if command == "compare" else []), tmp_path / "gone.csv"]
        assert "gone.csv" in refused(arguments, capsys)

    @pytest.mark.parametrize("command", ["identify", "compare"])
    def test_broken_log(self, command: str, logs: Path, model: Path, tmp_path: Path, capsys):
        lines = (logs / "b.csv").read_text().splitlines()
        lines[41] = lines[41].replace(",", ",x", 1)
        (tmp_path / "text.csv").write_text("\n".join(lines) + "\n")
        before = sorted(tmp_path.iterdir())
        where = ["-o", tmp_path / "m.json"] if command == "identify" else []
        where += ["--json", tmp_path / "r.json"]
        arguments = [command, *([model] if command == "compare" else []), tmp_path / "text.csv"]
        line = refused([*arguments, *where], capsys)
        assert "text.csv" in line and "row 42" in line and "velocity_fl" in line
        assert sorted(tmp_path.iterdir()) == before

    @pytest.mark.parametrize("option", ["-o", "--json"])
    @pytest.mark.parametrize("target", ["missing/folder/x.json", "."])
    def test_output_that_cannot_be(self, option: str, target: str, logs: Path, tmp_path, capsys):
        arguments = ["identify", logs / "calibration.csv", option, tmp_path / target]
        assert str(tmp_path) in refused(arguments, capsys)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("option", ["--predictions", "--plots"])
    def test_a_file_in_place_of_a_folder(
        self, option: str, logs: Path, model: Path, tmp_path: Path, capsys
    ):
        (tmp_path / "taken").write_text("mine")
        line = refused(["compare", model, logs / "b.csv", option, tmp_path / "taken"], capsys)
        assert "taken" in line
        assert (tmp_path / "taken").read_text() == "mine"

    def test_a_file_that_is_no_model(self, logs: Path, tmp_path: Path, capsys):
        (tmp_path / "m.json").write_text('{"schema_version": 1}')
        line = refused(["compare", tmp_path / "m.json", logs / "b.csv"], capsys)
        assert "m.json" in line
        assert "no such file" in refused(["compare", "papper", logs / "b.csv"], capsys)

    def test_a_geometry_that_is_none(self, logs: Path, tmp_path: Path, capsys):
        (tmp_path / "g.json").write_text('{"l": 0.15}')
        arguments = ["identify", logs / "b.csv", "--geometry", tmp_path / "g.json"]
        assert "g.json: geometry lacks 'h'" in refused(arguments, capsys)

    def test_a_missing_matplotlib_names_the_cure(
        self, logs: Path, model: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
    ):
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        arguments = ["compare", model, logs / "b.csv", "--plots", tmp_path / "plots"]
        assert "pip install 'youbot[plots]'" in refused(arguments, capsys)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="needs a shell's pipes")
def test_a_reader_that_closes_its_pipe_does_not_cost_the_model(logs: Path, tmp_path: Path):
    target = tmp_path / "m.json"
    run = "import sys; from youbot_scripts.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", run, "identify", str(logs / "calibration.csv"), "-o"]
    with subprocess.Popen([*command, str(target)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
    assert load_model(target).values
