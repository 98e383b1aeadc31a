"""--report of identify, compare and diagnose: what a page says, and when there is none."""

from __future__ import annotations

import base64
import functools
import html
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification.diagnosis.diagnose import diagnose
from identification.logs.reading import write_log
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from tests.identification.proposal.test_proposal import fitted_with, proposal_of
from tests.identification.recordings import recording
from youbot_scripts import cli

TILT = (("floor_tilt", (("tilt_x", 0.018), ("tilt_y", 0.0))),)
NAME = "run <script>x<|script> $\\bad$"
"""Of a log: neither a tag nor a formula, though it tries."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of a sloped floor under a nasty name, and one of an axis with a spring."""
    folder = tmp_path_factory.mktemp("logs")
    write_log(folder / f"{NAME}.csv", recording("calibration", TILT, rate=50.0))
    axis, theta = planted(STAGE, "spring")
    write_log(folder / "drive.csv", log_of(axis, theta, 100.0, noise=0.002))
    return folder


@pytest.fixture
def few_candidates(monkeypatch: pytest.MonkeyPatch):
    """A catalogue of two, for speed."""
    few = functools.partial(diagnose, effects=["floor_tilt", "quadratic_friction"])
    monkeypatch.setattr(sys.modules[diagnose.__module__], "diagnose", few)


def run(folder: Path, command: str, *arguments: object) -> tuple[str, dict[str, Any]]:
    """The page that a command writes, and its JSON."""
    report, result = folder / "page.html", folder / "result.json"
    line = [command, *map(str, arguments), "--report", str(report), "--json", str(result)]
    assert cli.main(line) == 0
    return report.read_text(), json.loads(result.read_text())


def visible(page: str) -> str:
    """A page's text without tags and scripts; indices and powers as a terminal has them."""
    page = re.sub(r"</?sub>|</sup>", "", page).replace("<sup>", "^").replace("µ", "mu")
    body = re.sub(r"(?s)<script.*?</script>", "", page[page.index("<body>") :])
    return html.unescape(re.sub(r"<[^>]*>", " ", body)).replace("\u00a0", " ")


def stands_alone(page: str) -> bool:
    """Nothing but the page's own scripts runs, and nothing is fetched."""
    rest = re.sub(r"(?s)<script.*?</script>", "", page)
    forbidden = "default-src 'none'" in page and "connect-src" not in page
    return forbidden and not re.search(r"(src|href)=\"(?!data:)|@import|url\(", rest)


def charts(page: str) -> set[str]:
    """Names of the page's interactive charts, without the number of the log."""
    return {re.sub(r"_\d+$", "", name) for name in re.findall(r'data-for="(\w+)"', page)}


def test_identify(folder: Path, tmp_path: Path):
    page, found = run(tmp_path, "identify", folder / f"{NAME}.csv", "-o", tmp_path / "m.json")
    text = visible(page)
    assert stands_alone(page) and NAME in text
    assert charts(page) == {"forces", "estimates", "residual"}
    force, floor = (
        100 * e["force_error"] for e in (found["errors"], found["errors"]["noise_floor"])
    )
    verdict = text.index("it does not fit")
    assert f"{force:.2f} %" in text[:verdict] and f"{floor:.2f} %" in text[:verdict]
    assert verdict < text.index("95 % interval") < text.index("What the force residual depends on")
    for name, entry in found["parameters"].items():
        assert re.search(rf"\b{name}\b +", text)
        assert entry["unit"] in text
    for warning in found["warnings"]:
        assert warning in text
    assert found["logs"][0]["sha256"] in text and found["version"] in text
    assert "youbot identify" in text and "--report" in text


def test_compare(folder: Path, tmp_path: Path):
    page, found = run(tmp_path, "compare", "paper", folder / f"{NAME}.csv")
    text = visible(page)
    assert stands_alone(page) and NAME in text
    assert charts(page) == {"free_run", "forces", "stretches", "plan", "residual"}
    for kind in ("force_error", "velocity_error"):
        for of in ("total", "noise_floor"):
            assert f"{100 * found[of][kind]:.2f} %" in text
    leading = [row for row in found["where"] if row["share"] > 0]
    assert leading
    for row in leading:
        assert row["variable"] in text and f"{100 * row['share']:.2f} %" in text
    assert "I0" in text and "kg m^2" in text, "the model's parameters"


@pytest.mark.usefixtures("few_candidates")
def test_diagnose(folder: Path, tmp_path: Path):
    page, found = run(tmp_path, "diagnose", "paper", folder / f"{NAME}.csv")
    text = visible(page)
    assert stands_alone(page) and found["missing"] == ["floor_tilt"]
    drawn = {"errors", "residual", "forces", "free_run", "plan_before", "plan_after"}
    assert charts(page) == drawn
    first = text.index("The model lacks floor tilt: the force error falls from")
    assert page.count("<mark>") == 3, "the effect's three terms"
    assert first < text.index(found["words"][0]) < text.index("The error as it falls")
    for step in found["steps"]:
        assert f"{100 * step['force_error']:.2f} %" in text
    assert "floor_tilt.tilt_x" in text and "What the residual of the refitted model" in text
    assert found["candidates"][1]["effect"] in text
    assert len(page) < 4e6, "charts' library is packed"
    # Through the residual goes what the slope takes away of it, and that is nearly all.
    drawn_data = re.findall(r'data-for="residual">(.*?)</script>', page, re.S)[0]
    lines = {(line["name"], line["xaxis"]): line for line in json.loads(drawn_data)["data"]}
    name, panel = "L F<sub>X</sub>, ", "x"
    before, taken = (
        np.frombuffer(base64.b64decode(lines[name + of, panel]["y"]["bdata"]), np.float32)
        for of in ("residual", "explained")
    )
    known = np.isfinite(before)
    assert lines[name + "residual", panel]["mode"] == "markers" and known.sum() > 5
    assert np.abs(before - taken)[known].max() < 0.2 * np.abs(before[known]).max()


@pytest.mark.usefixtures("few_candidates")
def test_a_proposed_law_is_a_step_of_its_own(folder: Path, tmp_path: Path, monkeypatch):
    """Marked as proposed in chart and table; and sizes with it and without it are told apart."""
    joint = fitted_with("dry_nap", "floor_tilt", tilt_x=0.0111, tilt_y=0.0)
    found = proposal_of("dry_nap", joint=joint)
    module = sys.modules[diagnose.__module__]
    monkeypatch.setattr(module, "propose", lambda data, steps, unexplained, fits: (steps, found))
    page, _ = run(tmp_path, "diagnose", "paper", folder / f"{NAME}.csv")
    text = re.sub(r"\s+", " ", visible(page))
    start = text.index("not confirmed")
    table = text[start : text.index("Filtered forces")]
    assert re.search(r"floor_tilt [\d.]+ % [\d.]+ % dry_nap \(proposed\) 1.20 % 2.00 %", table)
    drawn = json.loads(re.findall(r'data-for="errors">(.*?)</script>', page, re.S)[0])["data"]
    assert drawn[0]["y"][-1] == "+ dry_nap<br>(proposed)"
    assert drawn[0]["marker"]["pattern"]["shape"] == ["", "", "/"]
    sizes = text[text.index("Refitted parameters") :]
    assert re.search(
        r"floor_tilt.tilt_x 0.0111 ± 0.0010 0.0091 ... 0.0131 0.01[78]\d* [^a-z]*rad", sizes
    )
    assert re.search(r"dry_nap.force 1.00 ± 0.10 0.80 ... 1.20 - N", sizes)


def test_an_axis_has_reports_and_plots_too(folder: Path, tmp_path: Path, monkeypatch):
    few = functools.partial(diagnose, effects=["spring", "quadratic_friction"])
    monkeypatch.setattr(sys.modules[diagnose.__module__], "diagnose", few)
    log, model = folder / "drive.csv", tmp_path / "axis.json"
    axis = ("--mechanism", "axis", "--unit", "m", "-o", model, "--plots", tmp_path / "plots")
    page, found = run(tmp_path, "identify", log, *axis)
    assert stands_alone(page) and set(found["parameters"]) >= {"inertia", "viscous"}
    names = {path.name for path in (tmp_path / "plots").glob("*.png")}
    assert names == {"forces_drive.png", "motion_drive.png", "estimates.png"}
    page, found = run(tmp_path, "compare", model, log, "--plots", tmp_path / "more")
    assert "position" in visible(page) and found["where"][0]["variable"] == "position"
    names = {path.name for path in (tmp_path / "more").glob("*.png")}
    assert names == {"free_run_drive.png", "where_drive.png", "residual.png"}
    page, found = run(tmp_path, "diagnose", model, log)
    assert found["missing"] == ["spring"] and "spring.stiffness" in visible(page)


@pytest.mark.parametrize(
    ("command", "option"),
    [(command, "--report") for command in ("identify", "compare", "diagnose")]
    + [(command, "--plots") for command in ("identify", "compare")],
)
@pytest.mark.parametrize("library", ["matplotlib", "plotly", "jinja2", "latex2mathml"])
def test_without_a_library_nothing_is_begun(
    command: str, option: str, library: str, folder: Path, tmp_path: Path, capsys, monkeypatch
):

    def begun(*_: object, **__: object) -> None:
        raise AssertionError("logs are read already")

    if option == "--plots" and library != "matplotlib":
        pytest.skip("pictures need matplotlib alone")
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setattr("identification.logs.reading.read_logs", begun)
    output = tmp_path / "m.json"
    log = str(folder / "drive.csv")
    line = {
        "identify": ["identify", log, "-o", str(output)],
        "compare": ["compare", "paper", log],
        "diagnose": ["diagnose", "paper", log, "-o", str(output)],
    }[command]
    assert cli.main([*line, option, str(tmp_path / "out"), "--json", str(tmp_path / "r.json")]) == 2
    error = capsys.readouterr().err
    assert "pip install 'youbot[plots]'" in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("few_candidates")
def test_a_page_that_cannot_be_finished_leaves_the_old_one(
    folder: Path, tmp_path: Path, capsys, monkeypatch
):
    target = tmp_path / "page.html"
    target.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("youbot_scripts.shared.options.os.replace", fail)
    log = str(folder / f"{NAME}.csv")
    assert cli.main(["compare", "paper", log, "--report", str(target)]) == 2
    assert "No space left" in capsys.readouterr().err
    assert target.read_text() == "old" and list(tmp_path.iterdir()) == [target]
