"""`youbot benchmark` measures what it says; how fast a machine is no test can say."""

from __future__ import annotations

import json

import pytest

from tests.scripts.test_reports import charts, stands_alone, visible
from youbot_scripts.cli import main


def test_measures_and_writes_what_it_measured(tmp_path, capsys):
    path = tmp_path / "speed.json"
    asked = ["benchmark", "--quick", "--copies", "2,64", "--threads", "1", "--effects", "1"]
    report = tmp_path / "speed.html"
    assert main([*asked, "--json", str(path), "--report", str(report)]) == 0
    page = report.read_text()
    assert stands_alone(page) and charts(page) == {"rates", "ratios"}
    assert "One environment:" in visible(page) and "64 at once, 1 effect" in page
    found = json.loads(path.read_text())
    rows = [(row["case"], row["copies"], row["effects"]) for row in found["speeds"]]
    assert rows == [("one environment", 1, 0), ("batch", 2, 0), ("batch", 64, 0), ("batch", 64, 1)]
    for row in found["speeds"]:
        assert row["rate"] > 100 and row["peer_rate"] > 100
        assert row["ratio"] == pytest.approx(row["rate"] / row["peer_rate"], rel=2.0)
    assert found["speeds"][1]["bytes_a_copy"] <= 1024
    assert found["machine"]["versions"]["numba"]
    assert "CartPole" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("option", "value"), [("--copies", "many"), ("--copies", "0"), ("--effects", "9")]
)
def test_a_wrong_count_is_one_clear_line(option, value, capsys):
    assert main(["benchmark", "--quick", option, value]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and value in error
