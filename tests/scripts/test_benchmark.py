"""`youbot benchmark` measures what it says; how fast a machine is no test can say."""

from __future__ import annotations

import json

import pytest

from tests.scripts.test_reports import charts, stands_alone, visible
from youbot_scripts.benchmarks import benchmark
from youbot_scripts.benchmarks.learning import learning_speeds
from youbot_scripts.benchmarks.simulators import SimulatorSettings, simulators
from youbot_scripts.benchmarks.speed import Speed
from youbot_scripts.cli import main


def test_measures_and_writes_what_it_measured(tmp_path, capsys):
    path = tmp_path / "speed.json"
    asked = ["benchmark", "--quick", "--parts", "steps", "--copies", "2,64"]
    asked += ["--threads", "1", "--effects", "1"]
    report = tmp_path / "speed.html"
    assert main([*asked, "--json", str(path), "--report", str(report)]) == 0
    page = report.read_text()
    assert stands_alone(page) and charts(page) == {"rates", "ratios"}
    assert "One environment:" in visible(page) and "64 at once, 1 effect" in page
    found = json.loads(path.read_text())
    rows = [(row["case"], row["copies"], row["effects"]) for row in found["speeds"]]
    batches = [("batch", 2, 0), ("batch", 64, 0), ("batch", 64, 1)]
    single = [("batch float32", 2, 0), ("batch float32", 64, 0)]
    assert rows == [("one, CartPole", 1, 0), ("one, Pendulum", 1, 0), *batches, *single]
    for row in found["speeds"]:
        assert row["rate"] > 100 and row["peer_rate"] > 100
        assert row["ratio"] == pytest.approx(row["rate"] / row["peer_rate"], rel=2.0)
    memory = [row["bytes_a_copy"] for row in found["speeds"]]
    assert memory[2] <= 1024 and memory[-1] < 0.75 * memory[2]
    assert 0 < found["single_precision"]["twist"] < 1e-6
    assert found["machine"]["versions"]["numba"]
    out = capsys.readouterr().out
    assert (
        "one, CartPole " in out and max(map(len, out.split("report written")[0].splitlines())) <= 80
    )


def test_measures_without_what_is_not_installed(monkeypatch):
    monkeypatch.setattr(benchmark.importlib.util, "find_spec", lambda name: None)
    assert benchmark.usual_parts(False) == ("steps", "simulators", "logs", "imports")
    monkeypatch.undo()
    assert benchmark.usual_parts(True) == ("steps", "simulators")


@pytest.mark.slow
def test_moves_simulators_for_the_same_time():
    rows = simulators(SimulatorSettings(rounds=3, steps=10), platforms=64)
    found = {row.name: row for row in rows}
    assert found["environment, batch: full"].ratio == 1.0
    # Rolling contacts cost some thousand times as much: ten says that the order is right.
    contact = found["MuJoCo, rollers in contact: bare"]
    assert contact.ratio > 10 and contact.by_contact == 1.0
    bare = found["Plant, batch: bare"]
    assert bare.by_contact == pytest.approx(contact.ratio / bare.ratio, rel=0.5)


def test_draws_what_was_measured(tmp_path):
    batches = [Speed("batch", n, 1, 0, 1e6, 2e6, 0.5, 500) for n in (1, 64)]
    found = benchmark.Benchmark(batches, logs=[benchmark.LogTime(200.0, 20_000, 1.5, 9.0)])
    drawn = benchmark.draw(found, tmp_path)
    assert [path.name for path in drawn] == ["steps_by_copies.png", "seconds_by_length.png"]
    assert all(path.stat().st_size > 1000 for path in drawn)


def test_times_logs_by_their_length(monkeypatch, capsys):
    times = [benchmark.LogTime(200.0, 20_000, 1.5, None)]
    monkeypatch.setattr(benchmark, "log_times", lambda lengths, diagnosed: times)
    assert main(["benchmark", "--quick", "--parts", "logs"]) == 0
    out = capsys.readouterr().out
    assert "200 s" in out and "1.50" in out and "CartPole" not in out


@pytest.mark.slow
def test_ppo_learns_faster_on_compiled_copies():
    ours, theirs, alike = learning_speeds(4096)
    assert ours.rate > 5 * theirs.rate and ours.rate > alike.rate
    assert (ours.a_round, ours.batch, ours.epochs) == (alike.a_round, alike.batch, alike.epochs)


@pytest.mark.slow
def test_identifies_and_diagnoses_logs_of_a_length():
    (found,) = benchmark.log_times([20.0], 20.0)
    assert found.rows > 15_000 and found.identify > 0.0
    assert found.diagnose is not None and found.diagnose > found.identify


@pytest.mark.parametrize(
    ("option", "value"),
    [("--copies", "many"), ("--copies", "0"), ("--effects", "9"), ("--parts", "colours")],
)
def test_a_wrong_count_is_one_clear_line(option, value, capsys):
    assert main(["benchmark", "--quick", option, value]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and value in error
