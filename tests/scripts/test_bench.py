"""The blind bench: its simulator against the package's own, its cases, and its scores."""

from __future__ import annotations

import ast
import json
import math
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification.logs.reading import read_logs
from identification.mechanisms.mecanum import Mecanum
from tests.identification.proposal.test_proposal import fitted_with
from tests.identification.shared_data import DATA, needs_data
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import motion_iii
from youbot_env.physics.effect import CATALOGUE as REGISTERED
from youbot_env.simulation.free_run import initial_state, simulate
from youbot_env.simulation.plant import Plant
from youbot_scripts import blind_bench
from youbot_scripts.blind_bench import (
    cases,
    effects,
    motions,
    scores,
    second_simulator as plant,
    trials,
)
from youbot_scripts.blind_bench.effect_sizes import Sizing, size_table
from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.cli import main
from youbot_scripts.shared.results_folder import RESULTS
from youbot_scripts.shared.workers import spread

FOLDER = Path(next(iter(blind_bench.__path__)))


# --- the simulator ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "module", ["second_simulator", "motions", "draws", "effects", "sensors", "cases"]
)
def test_the_generator_shares_no_physics_with_the_package(module: str):
    tree = ast.parse((FOLDER / f"{module}.py").read_text())
    names = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    names |= {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    ours = {n for n in names if n and n.startswith(("youbot", "identification", "controllers"))}
    logs_alone = (
        {"identification.logs.log", "identification.logs.reading", "youbot_env.errors"}
        if module == "cases"
        else set()
    )
    others = {name for name in ours if not name.startswith("youbot_scripts.blind_bench")}
    # Where compiled functions are kept on the disk is no physics.
    assert others - {"youbot_env.caching"} <= logs_alone


def derivative(case: cases.Case, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """What the generator says of a state in the order of the package's own."""
    (vx, vy, wz), pose, time = state[:3], state[3:6], state[10]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    q = np.zeros(18)
    q[:3], q[3:6], q[6:10] = pose, (c * vx - s * vy, s * vx + c * vy, wz), state[6:10]
    # What stands behind the platform's own state: drives, and when the log began.
    known = trials.true_model(case)
    names = known.structure.state_names[11:] if known else ()
    more = dict(zip(names, state[11:], strict=True))
    drives = [name for name in names if name != "start"]
    q[10 : 10 + len(drives)] = [more[name] for name in drives]
    p, dq = cases.physics(case)._replace(began=more.get("start", 0.0)), np.zeros(18)
    plant.derivative(p, q, torque, time, time >= p.load_time, np.empty((5, 3)), dq)
    ax, ay = c * dq[3] + s * dq[4] + wz * vy, c * dq[4] - s * dq[3] - wz * vx
    rates = [ax, ay, dq[5], *dq[:3], *dq[6:10], 1.0]
    return np.array([*rates, *dq[10 : 10 + len(drives)], *([0.0] if "start" in names else [])])


def truth_of(case: cases.Case) -> Model:
    found = trials.true_model(case)
    if found is None:
        pytest.skip("the effect is not in the catalogue yet")
    return found


OF_PHYSICS = [*(n for n in effects.CATALOGUE if n != "torque_delay")]
OF_PHYSICS += ["wheel_radius_error", "roller_angle_error"]


@pytest.mark.parametrize("name", ["none", *OF_PHYSICS])
def test_two_statements_of_the_same_physics_agree(name: str):
    """Each effect on random platforms, sizes and states: to rounding."""
    rng = np.random.default_rng(1)
    for index in range(3):
        case = cases.draw_case(name, index, 7)
        model = truth_of(case)
        size = len(model.structure.state_names)
        for _ in range(20):
            state = (
                rng.standard_normal(size) * np.r_[0.2, 0.2, 0.5, np.ones(7), 0, np.ones(size - 11)]
            )
            state[10] = rng.uniform(0.0, 60.0)
            if model.structure.reads_start:
                state[-1] = rng.uniform(0.0, 60.0)
            torque = rng.standard_normal(4)
            expected = model.state_derivative(state, torque)
            np.testing.assert_allclose(derivative(case, state, torque), expected, 1e-9, 1e-9)


def held(time: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and torques of a held command for a simulation that goes linearly between samples."""
    ends = time[1:] - 1e-9
    return np.sort(np.r_[time, ends]), np.repeat(command, 2, axis=0)[: 2 * len(time) - 1]


def test_a_free_run_of_the_package_follows_the_generator():
    case = cases.draw_case("none", 4, 0)
    twist = motions.calibration(0.002)[:5000]
    speed, command, pose = cases.simulate(case, twist, 0.002)
    model = truth_of(case)
    time, torque = held(0.002 * np.arange(len(twist)), command)
    states = simulate(model, time, torque, initial_state(model))[::2]
    own = motions.wheel_speeds(states[:, :3])
    assert np.abs(speed).max() > 5.0
    assert np.abs(own - speed).max() < 1e-5
    assert np.abs(states[:, 3:6] - pose).max() < 1e-6


@pytest.mark.parametrize("name", effects.KINEMATICS)
def test_wheels_and_speeds_are_shown_as_the_package_shows_them(name: str):
    """A plant of the package under the generator's commands logs the generator's speeds."""
    case = replace(cases.draw_case(name, 1, 3, noise=0.0), has_pose=False)
    dt, ticks = cases.tick(case.rate)
    twist = motions.calibration(dt)[:2001]
    log = cases.log_along(case, "part", twist)
    _, command, _ = cases.simulate(case, twist, dt)
    plant = Plant(truth_of(case))
    plant.reset()
    shown = []
    for torque in command:
        shown.append(plant.wheel_speed)
        plant.step(torque, dt)
    rows = np.arange(ticks, len(command) - 1, ticks)
    assert np.abs(log.velocity).max() > 2.0
    # A creeping wheel is shown under the command before or after an instant.
    loose = 0.05 if name == "wheel_creep" else 0.01 if name == "speed_filter" else 1e-3
    assert np.abs(np.array(shown)[rows] - log.velocity).max() < loose


def test_a_positive_delay_means_that_speeds_lag_torques():
    """True torque at t is the logged one at t - delay."""
    late = replace(cases.draw_case("torque_delay", 0, 0, noise=0.0), has_pose=False)
    late = replace(late, planted=(replace(late.planted[0], values={"delay": 0.05}),))
    prompt = replace(late, planted=())
    twist = motions.calibration(0.002)[:5001]
    logs = [cases.log_along(case, "part", twist) for case in (late, prompt)]
    assert np.array_equal(logs[0].velocity, logs[1].velocity)
    assert np.array_equal(logs[0].effort[:-5], logs[1].effort[5:])


@pytest.mark.parametrize("name", effects.EVERYTHING)
def test_steps_are_fine_enough_for_every_effect(name: str, monkeypatch):
    case = cases.draw_case(name, 0, 3, factor=2.0)
    twist = motions.calibration(0.002)[::4][:1500]
    usual, *_ = cases.simulate(case, twist, 0.002)
    monkeypatch.setattr(plant, "steps_for", lambda p, dt: 16)
    fine, *_ = cases.simulate(case, twist, 0.002)
    assert np.isfinite(usual).all() and np.abs(usual).max() > 1.0
    # A load that comes within a step, or a dry contact, is late by one step at most.
    assert np.abs(usual - fine).max() < 2e-3


@pytest.mark.parametrize("name", ["carpet_nap", "sticky_patch"])
def test_dry_ground_takes_energy_away(name: str):
    case = cases.draw_case(name, 0, 0)
    bare = replace(case, planted=())
    rng = np.random.default_rng(0)
    for _ in range(200):
        state = rng.standard_normal(11) * np.r_[0.2, 0.2, 0.5, np.ones(8)]
        at = (state, np.zeros(4))
        change = derivative(case, *at) - derivative(bare, *at)
        power = state[:3] @ truth_of(bare).mass_matrix() @ change[:3]
        assert power <= 1e-12


# --- the cases -------------------------------------------------------------------------------


GIVEN = ("nominal_1", "wheel_coulomb_friction", "floor_tilt", "actuator_lag", "unknown_carpet_nap")


def given_case(name: str) -> tuple[cases.Case, np.ndarray]:
    """The case that a given folder was made of, and its calibration log."""
    known = json.loads((DATA / name / "truth.json").read_text())
    keys = {"aX": "ax", "aY": "ay"}
    platform = {key: known[keys.get(key, key)] for key in cases.RANGES}
    short = {value: key for key, value in cases.SHORT_NAMES.items()}
    planted: dict[str, dict[str, float]] = {}
    for key, value in known["effects"].items():
        effect, _, parameter = short[key].partition(".")
        planted.setdefault(effect, {})[parameter] = value
    rows = np.loadtxt(DATA / name / "calibration.csv", delimiter=",", skiprows=1)
    what = tuple(effects.Planted(key, 1.0, values) for key, values in planted.items())
    return cases.Case("given", 0, 0, 100.0, 1.0, True, platform, what), rows


@needs_data
@pytest.mark.parametrize("name", GIVEN)
def test_a_given_log_comes_out_again_but_for_its_noise(name: str):
    """Same platform, loop and motions: what is left of the given log is its stated noise."""
    case, rows = given_case(name)
    speed, command, _ = cases.simulate(case, motions.calibration(0.002), 0.002)
    at = 5 * np.arange(1, len(rows) + 1)
    assert (rows[:, 1:5] - speed[at]).std() == pytest.approx(0.010, rel=0.05)
    effort = 0.5 * (command[at] + command[at - 1])
    assert (rows[:, 5:9] - effort).std() == pytest.approx(0.030, rel=0.02)


@pytest.mark.slow
@needs_data
def test_multisines_are_like_the_given_ones():
    def twist_rms(log: np.ndarray) -> np.ndarray:
        to_body = np.linalg.pinv(motions.wheel_speeds(np.eye(3)).T)
        return (log @ to_body.T).std(axis=0)

    given = [
        twist_rms(np.loadtxt(path, delimiter=",", skiprows=1)[:, 1:5])
        for path in sorted(DATA.glob("*/multisine_[ab].csv"))
        if not path.parent.name.startswith("mujoco")
    ]
    own = [
        twist_rms(log.velocity)
        for index in range(12)
        for log in cases.logs_of(cases.draw_case("none", index, 0, rate=50.0))[1:]
    ]
    assert np.mean(own, axis=0) == pytest.approx(np.mean(given, axis=0), rel=0.12)


def test_the_same_seed_gives_the_same_logs():
    for kind in ("none", "two", "unknown"):
        first, again, other = (cases.logs_of(cases.draw_case(kind, 3, seed)) for seed in (5, 5, 6))
        for a, b, c in zip(first, again, other, strict=True):
            assert np.array_equal(a.effort, b.effort) and np.array_equal(a.velocity, b.velocity)
            assert not np.array_equal(a.effort, c.effort)


@pytest.mark.parametrize("rate", [20.0, 30.0, 50.0, 100.0, 250.0, 1000.0])
def test_rows_come_at_the_rate_asked_for(rate: float):
    calibration, a, b = cases.logs_of(cases.draw_case("none", 0, 0, rate=rate))
    assert calibration.rate == pytest.approx(rate)
    assert calibration.duration == pytest.approx(140.0, abs=3 / rate)
    assert a.duration == pytest.approx(60.0, abs=3 / rate)
    assert not np.array_equal(a.velocity, b.velocity)
    with pytest.raises(InputError, match="20 to 1000"):
        cases.draw_case("none", 0, 0, rate=5.0)


def test_noise_is_white_and_of_the_size_asked_for():
    loud, quiet = (
        cases.logs_of(cases.draw_case("none", 0, 0, rate=100.0, noise=x))[0] for x in (2.0, 0.0)
    )
    noise = np.column_stack([loud.effort - quiet.effort, loud.velocity - quiet.velocity])
    assert noise[:, :4].std() == pytest.approx(0.06, rel=0.02)
    assert noise[:, 4:].std() == pytest.approx(0.02, rel=0.02)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 1e-4 * 0.06


def test_every_effect_meets_its_turn():
    names = list(effects.CATALOGUE)
    kinds = {"one": 15, "quarter": 15, "double_noise": 15, "unknown": len(effects.OUTSIDE)}
    kinds |= {"law": len(effects.BEYOND), "foreign": len(effects.FOREIGN)}
    for kind, turn in kinds.items():
        drawn = [cases.draw_case(kind, i, 0) for i in range(turn)]
        assert len({case.planted[0].name for case in drawn}) == turn
    assert cases.draw_case("none", 0, 0).planted == ()
    loud = cases.draw_case("double_noise", 4, 0)
    assert loud.noise == 2.0 and 0.7 < loud.planted[0].factor < 1.5
    for index in range(30):
        two = [item.name for item in cases.draw_case("two", index, 0).planted]
        assert len(set(two)) == 2 and set(two) <= set(names)
    sweep = [cases.draw_case("sweep", i, 0) for i in range(len(cases.SWEEP) * len(names))]
    assert {(case.planted[0].name, case.planted[0].factor) for case in sweep} == {
        (name, factor) for name in names for factor in cases.SWEEP
    }
    with pytest.raises(InputError, match="not known"):
        cases.draw_case("carpets", 0, 0)


@pytest.mark.parametrize("name", effects.CATALOGUE)
def test_drawn_values_are_parameters_of_the_effect_within_its_bounds(name: str):
    if name not in REGISTERED:
        pytest.skip("the effect is not in the catalogue yet")
    for index in range(5):
        assert trials.true_model(cases.draw_case(name, index, 0, factor=4.0)) is not None


def test_relative_values_are_relative():
    for index in range(10):
        gains = cases.draw_case("torque_gain_error", index, 0).planted[0].values
        extra = cases.draw_case("uneven_wheel_friction", index, 0).planted[0].values
        assert sum(gains.values()) == pytest.approx(0.0, abs=1e-12)
        assert min(extra.values()) == 0.0 < max(extra.values())


def test_written_cases_are_logs_like_the_given_ones(tmp_path: Path, capsys):
    arguments = ["bench", "--write", str(tmp_path), "--cases", "1", "--kinds", "floor_tilt,none"]
    assert main(arguments) == 0
    assert "2 cases" in capsys.readouterr().out
    folder = next(tmp_path.glob("floor_tilt-*"))
    logs = read_logs(sorted(folder.glob("*.csv")))
    assert [log.name for log in logs] == ["calibration", "multisine_a", "multisine_b"]
    answer = json.loads((folder / "truth.json").read_text())
    assert {"m0", "ax", "mu2", "effects", "delay", "torque_noise", "planted"} <= set(answer)
    assert set(answer["effects"]) == {"tilt_x", "tilt_y"}


# --- the trials ------------------------------------------------------------------------------


class Answer:
    """A diagnosis that says what it is told to."""

    def __init__(self, **report: Any) -> None:
        self.report = {"verdict": "adequate", "missing": [], "ambiguous_with": {}} | report

    def to_dict(self) -> dict[str, Any]:
        return self.report


class Diagnose:
    """Says "adequate" of everything, and counts; may be told to stop."""

    def __init__(self, stop_after: int = 10**9) -> None:
        self.calls, self.stop_after = 0, stop_after

    def __call__(self, model: Model, logs: list, *, seed: int = 0) -> Answer:
        assert model.name == "paper" and len(logs) == 3
        if self.calls == self.stop_after:
            raise KeyboardInterrupt
        self.calls += 1
        steps = [{"effect": None, "force_error": np.float64(0.01), "velocity_error": 0.02}]
        return Answer(steps=steps, where=[{"variable": "twist", "share": 0.0}])


SPECS = trials.plan(["none", "unknown"], 2, 0, rates=[50.0])


def test_kinds_take_turns():
    assert [(s.kind, s.index) for s in SPECS] == [
        ("none", 0), ("unknown", 0), ("none", 1), ("unknown", 1),
    ]  # fmt: skip
    mixed = trials.plan(["one"], 2 * len(effects.CATALOGUE), 0, rates=[50.0, 100.0])
    assert {(s.draw().planted[0].name, s.rate) for s in mixed} == {
        (name, rate) for name in effects.CATALOGUE for rate in (50.0, 100.0)
    }


def test_an_interrupted_bench_is_taken_up_where_it_stopped(tmp_path: Path):
    first, second, third = Diagnose(stop_after=3), Diagnose(), Diagnose()
    with pytest.raises(KeyboardInterrupt):
        trials.run_trials(SPECS, first, folder=tmp_path)
    path = tmp_path / RESULTS
    path.write_text(path.read_text() + '{"case": {"key": "cut sho')
    found = trials.run_trials(SPECS, second, folder=tmp_path)
    again = trials.run_trials(SPECS, third, folder=tmp_path)
    assert (first.calls, second.calls, third.calls) == (3, 1, 0)
    assert [r["case"]["key"] for r in found] == [s.draw().key for s in SPECS]
    assert found == again


def test_a_folder_of_something_else_is_refused(tmp_path: Path):
    (tmp_path / RESULTS).write_text("a line\nanother\n")
    with pytest.raises(InputError, match="row 1: not a trial"):
        trials.run_trials(SPECS, Diagnose(), folder=tmp_path)


def test_a_crash_is_a_record_and_no_end():
    def crash(model: Model, logs: list, *, seed: int = 0) -> Answer:
        raise ZeroDivisionError("a bug")

    found = trials.run_trials(SPECS[:2], crash)
    assert [record["error"] for record in found] == ["ZeroDivisionError: a bug"] * 2
    assert {record["error_class"] for record in found} == {"ZeroDivisionError"}
    assert found[0]["raised_at"].startswith("test_bench.py:")
    table = scores.score(found)["kinds"]["none"]
    assert table["false_alarm"]["count"] == table["crashed"]["count"] == 1
    assert (table["refused"]["count"], table["verdicts"]) == (0, {"error": 1})
    assert len(trials.errors_of(found)) == 2


def test_a_refusal_is_no_crash():
    def refuse(model: Model, logs: list, *, seed: int = 0) -> Answer:
        raise InputError("m0 = 4 kg")

    found = trials.run_trials(SPECS[:1], refuse)
    table = scores.score(found)["kinds"]["none"]
    assert found[0]["error"] == "m0 = 4 kg"
    assert (table["refused"]["count"], table["crashed"]["count"]) == (1, 0)
    assert table["right"]["count"] == table["wrongly_named"]["count"] == 0


def test_a_case_without_an_end_is_given_up_and_its_time_counted():
    def never(model: Model, logs: list, *, seed: int = 0) -> Answer:
        while True:
            time.sleep(0.01)

    case = cases.draw_case("none", 0, 0, rate=50.0)
    found = trials.run_trial(case, never, trials.Options(limit=0.7))
    assert found["error"] == "TimeoutError: no answer in 0.7 s"
    assert 0.0 < found["seconds"] < 3.0 and scores.crashed(found)
    time.sleep(0.8)  # no alarm is left


def test_what_libraries_warn_of_is_kept_once():
    def warn(model: Model, logs: list, *, seed: int = 0) -> Answer:
        for _ in range(3):
            np.log(np.zeros(1))
        return Answer()

    found = trials.run_trial(cases.draw_case("none", 0, 0, rate=50.0), warn)
    assert found["library_warnings"] == ["RuntimeWarning: divide by zero encountered in log"]
    quiet = found | {"library_warnings": []}
    assert scores.score([found, quiet])["kinds"]["none"]["warned"]["count"] == 1


def test_a_kept_case_holds_its_logs_its_truth_and_its_trial(tmp_path: Path):
    spec = trials.plan(["none"], 1, 0, rates=[50.0], first=3)[0]
    assert spec.index == 3

    def identify(logs: list, *, seed: int = 0):
        raise InputError("mass below the wheels'")

    options = trials.Options(identify, keep=tmp_path)
    record = trials.run_trials([spec], Diagnose(), options=options)[0]
    folder = tmp_path / record["case"]["key"]
    assert {path.name for path in folder.iterdir()} == {
        "calibration.csv", "multisine_a.csv", "multisine_b.csv", "truth.json", "trial.json",
    }  # fmt: skip
    kept = json.loads((folder / "trial.json").read_text())
    assert kept["identify"]["error"] == "mass below the wheels'"
    assert kept["found"]["verdict"] == "adequate", "the diagnosis goes on where identify refuses"
    assert scores.score([record])["kinds"]["none"]["identify_failed"]["count"] == 1


def test_a_verdict_without_a_model_has_the_sizes_of_its_report():
    """Something else that names effects may have no model, and the trial goes on."""

    class Found:
        model = None

    stated = {"effect": "floor_tilt", "parameters": {"tilt_x": {"value": 0.02, "std": 0.001}}}
    report = {"missing": ["floor_tilt"], "candidates": [stated]}
    assert trials.stated_sizes(Found(), report) == {
        "floor_tilt.tilt_x": {"value": 0.02, "std": 0.001}
    }


def test_sizes_beside_a_law_are_those_that_are_told():
    """Those of the fit with the law, and none of the law itself."""

    class Found:
        model = load_model("paper").with_effect("cable_drag", force=5.0)
        told = fitted_with("dry_nap", "cable_drag", force=3.0)

    sizes = trials.stated_sizes(Found(), {})
    assert sizes["cable_drag.force"] == {"value": 3.0, "std": 0.001}
    assert not any(name.startswith("dry_nap") for name in sizes)
    assert set(trials.stated_base(Found.told)) == set(Found.model.parameters)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, sys, time\n"
        "from youbot_scripts.shared.workers import spread\n"
        "def work(item):\n"
        "    open(os.path.join(sys.argv[1], str(os.getpid())), 'w').close()\n"
        "    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    list(spread(work, [1, 2], 2))\n"
    )
    folder = tmp_path / "pids"
    folder.mkdir()
    parent = subprocess.Popen([sys.executable, str(script), str(folder)])
    wait_for(lambda: len(list(folder.iterdir())) == 2)
    parent.kill()
    parent.wait()
    for worker in folder.iterdir():
        wait_for(lambda worker=worker: not is_alive(int(worker.name)))


def wait_for(what, seconds=30.0):
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


def is_alive(process: int) -> bool:
    try:
        # A zombie that nobody waits for has ended too.
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


def test_spread_over_processes_gives_what_one_process_gives():
    items = [1.0, 4.0, 9.0]
    assert sorted(spread(math.sqrt, items, 2)) == list(spread(math.sqrt, items, 1))


def test_a_proposed_experiment_is_recorded_on_the_same_platform():
    seen = []

    def tie(model: Model, logs: list, *, seed: int = 0) -> Answer:
        seen.append(logs)
        motion = motion_iii(duration=10.0).to_dict()
        answer = Answer(**said("ambiguous", "tether", tether=["floor_tilt"]))
        answer.report |= {"next_experiment": {"motion": motion}}
        return answer

    case = cases.draw_case("tether", 0, 0)
    found = trials.run_trial(case, tie, trials.Options(follow_up=True))
    assert found["after"]["missing"] == ["tether"]
    assert [len(logs) for logs in seen] == [3, 4]
    log = seen[1][-1]
    assert log.name == "next_experiment" and log.rate == pytest.approx(case.rate)
    assert log.duration == pytest.approx(10.0, abs=0.05)
    assert np.abs(log.velocity).max() > 3.0


def test_truth_s_error_is_that_of_noise_alone():
    record = trials.run_trial(cases.draw_case("none", 0, 0, rate=100.0, noise=1.0), Diagnose())
    assert 0.0 < record["true_velocity_error"] < 0.02
    assert record["found"]["verdict"] == "adequate"


@pytest.mark.slow
def test_the_command_prints_scores_and_writes_them(tmp_path: Path, monkeypatch, capsys):
    diagnosis = pytest.importorskip("identification.diagnosis.diagnose")
    monkeypatch.setattr(diagnosis, "diagnose", Diagnose())
    out = tmp_path / "scores.json"
    arguments = ["--cases", "1", "--rates", "50", "--jobs", "1", "--json", str(out)]
    assert main(["bench", *arguments, "--kinds", "none,one,two,unknown"]) == 0
    printed = capsys.readouterr().out
    assert (
        "nothing planted: 1 cases (adequate 1)" in printed and "wheel_coulomb_friction" in printed
    )
    found = json.loads(out.read_text())
    assert found["kinds"]["none"]["false_alarm"]["share"] == 0.0
    assert found["kinds"]["unknown"]["said_unknown"]["share"] == 0.0
    assert len(found["trials"]) == 4
    assert found["kinds"]["none"]["identified_base_all_within_3"]["total"] == 1
    assert "not right: one-0-0-50Hz-x1 (case 0 of its kind; wheel_coulomb_friction)" in printed
    assert main(["bench", "--kinds", "carpets"]) == 2
    assert main(["bench", "--rates", "fast"]) == 2


# --- the scores ------------------------------------------------------------------------------


def record(
    what: str = "", found: dict[str, Any] | None = None, kind: str = "one", **more: Any
) -> trials.Record:
    """A trial by hand: ``what`` is planted, ``found`` was said."""
    planted = [{"name": n, "factor": 1.0, "values": {"torque": 0.2}} for n in what.split("+") if n]
    case = {"kind": kind, "key": what, "rate": 100.0, "planted": planted}
    return {
        "case": case,
        "carriers": [],
        "seconds": 1.0,
        "found": Answer(**(found or {})).report,
        **more,
    }


def said(verdict: str, *missing: str, **ties: list[str]) -> dict[str, Any]:
    return {"verdict": verdict, "missing": list(missing), "ambiguous_with": ties}


def test_shares_have_exact_intervals():
    assert Proportion(0, 200).interval() == pytest.approx((0.0, 1 - 0.025 ** (1 / 200)))
    assert Proportion(4, 200).interval() == pytest.approx((0.00548, 0.05041), abs=1e-5)
    assert Proportion(200, 200).interval()[1] == 1.0
    assert math.isnan(Proportion.of([None]).value)
    assert Proportion.of([True, None, False]) == Proportion(1, 2)


def test_a_name_counts_alone_or_in_a_set_of_three():
    right = record("tether", said("effect", "tether"))
    tied = record("tether", said("ambiguous", "floor_tilt", floor_tilt=["tether"]))
    large = record("tether", said("ambiguous", "a", a=["b", "tether", "d"]))
    wrong = record("tether", said("effect", "floor_tilt"))
    both = record("tether", said("effect", "tether", "floor_tilt"))
    rows = (right, tied, large, wrong, both)
    assert [scores.in_set(r, "tether") for r in rows] == [True, True, False, False, True]
    assert [scores.alone(r) for r in rows] == [True, False, False, False, False]
    assert [scores.confidently_wrong(r) for r in rows] == [False, False, False, True, False]
    assert [scores.accepted_unplanted(r) for r in rows] == [False, False, False, True, True]


def test_a_partial_fit_is_not_a_wrong_name():
    partial = record("carpet_nap", said("unknown", "floor_tilt"), kind="unknown")
    twice = record("carpet_nap", said("unknown", "floor_tilt", "tether"), kind="unknown")
    assert scores.said_unknown(partial) and not scores.confidently_wrong(partial)
    assert not scores.said_unknown(twice)
    assert scores.answer(partial) == "unknown"


def counted(what: str, found: dict[str, Any] | None) -> trials.Record:
    row = record(what, found, kind="counts")
    row["case"]["sensing"] = {"name": "encoder_counts", "values": {"counts": 500.0}}
    return row


def test_of_counted_speeds_an_unknown_without_a_wrong_name_is_right():
    coulomb = "wheel_coulomb_friction"
    for what, answer, right, wrong in (
        (coulomb, said("effect", coulomb), True, False),
        (coulomb, said("unknown"), True, False),
        (coulomb, said("unknown", coulomb), True, False),
        (coulomb, said("unknown", "tether"), False, True),
        (coulomb, said("effect", "tether"), False, True),
        (coulomb, said("adequate"), False, False),
        ("", said("adequate"), True, False),
        ("", said("unknown"), True, False),
        ("", said("unknown", coulomb), False, True),
    ):
        row = counted(what, answer)
        assert (scores.right(row), scores.wrongly_named(row)) == (right, wrong), (what, answer)
    table = scores.score([counted("", said("adequate")), counted(coulomb, said("adequate"))])
    by = table["kinds"]["counts"]["right_by_sensing"]
    assert {name: share["count"] for name, share in by.items()} == {
        "nothing, 500 counts": 1,
        f"{coulomb}, 500 counts": 0,
    }


def test_each_kind_of_case_has_its_right_answer():
    empty = [record("", said(*answer), kind="noise") for answer in (("adequate",), ("unknown",))]
    assert [scores.right(row) for row in empty] == [True, False]
    assert not scores.wrongly_named(empty[1])
    assert scores.wrongly_named(record("", said("unknown", "tether"), kind="noise"))
    partial = record("carpet_nap", said("unknown", "floor_tilt"), kind="unknown")
    sure = record("carpet_nap", said("effect", "floor_tilt"), kind="unknown")
    assert scores.right(partial) and not scores.wrongly_named(partial)
    assert scores.wrongly_named(sure) and not scores.right(sure)
    tied = record("tether", said("ambiguous", "floor_tilt", floor_tilt=["tether"]))
    assert scores.right(tied) and not scores.wrongly_named(tied)
    one_of_two = record("tether+floor_tilt", said("effect", "tether"), kind="two")
    assert not scores.right(one_of_two) and not scores.wrongly_named(one_of_two)


def test_base_parameters_are_judged_by_their_intervals():
    def stating(**stds: float | None) -> dict[str, Any]:
        return {name: {"value": 1.2, "std": std} for name, std in stds.items()}

    row = record("", said("adequate"), kind="noise", base=stating(m0=0.15, I0=0.09, I1=None))
    row["case"]["platform"] = dict.fromkeys(("m0", "I0", "I1"), 1.0)
    row["identify"] = {"base": stating(m0=0.01)}
    table = scores.score([row])["kinds"]["noise"]
    counts = {key: (table[key]["count"], table[key]["total"]) for key in table if "base_" in key}
    assert counts == {
        "base_stated": (2, 3),
        "base_inside": (1, 2),
        "base_within_3": (2, 2),
        "base_all_within_3": (1, 1),
        "identified_base_stated": (1, 1),
        "identified_base_inside": (0, 1),
        "identified_base_within_3": (0, 1),
        "identified_base_all_within_3": (0, 1),
    }


def test_shares_that_a_diagnosis_states_are_given_as_medians():
    rows = [
        record("tether", said("unknown") | {"explained_share": share}) for share in (0.2, 0.6, None)
    ]
    table = scores.score([*rows, record("tether", said("unknown"))])["kinds"]["one"]
    assert table["explained_share_median"] == pytest.approx(0.4)
    assert table["predictable_share_median"] is None


def test_two_effects_are_found_in_either_order():
    found = said("effect", "floor_tilt", "wheel_stribeck_friction")
    row = record("wheel_coulomb_friction+floor_tilt", found, kind="two")
    table = scores.score([row])["kinds"]["two"]
    assert table["both_found"]["count"] == 0
    assert table["coulomb_called_stribeck"]["count"] == 1
    right = said("effect", "floor_tilt", "wheel_coulomb_friction")
    row = record("wheel_coulomb_friction+floor_tilt", right, kind="two")
    table = scores.score([row])["kinds"]["two"]
    assert (table["both_found"]["count"], table["exactly_both"]["count"]) == (1, 1)


def test_the_carrier_is_ranked_among_what_lies_beyond_the_twist():
    where = [
        {"variable": "position_x", "share": 0.1},
        {"variable": "twist", "share": 0.9},
        {"variable": "heading", "share": 0.3},
    ]
    row = record("bump", {"where": where}, kind="unknown", carriers=["position_x", "position_y"])
    assert scores.carrier_rank(row) == 2
    assert scores.carrier_rank(row, "remaining") == 2, "nothing was accepted: the first map stands"
    row["found"]["remaining"] = [{**where[0], "variable": "time"}, where[2]]
    assert scores.carrier_rank(row, "remaining") == 3
    assert scores.carrier_rank(record("sideways_drift", {"where": where})) is None


def test_a_proposed_law_is_judged_by_its_site_its_variable_and_its_error():
    law = {"name": "uneven_ripple_of_wheels", "site": "wheel", "variables": ["wheel_angle"]}
    unseen = {"base": 0.2, "law": 0.05, "truth": 0.02}
    row = record("cogging_wheel", {"verdict": "unknown", "proposal": law}, unseen=unseen)
    assert scores.law_proposed(row) and scores.law_right(row) and scores.law_helps(row)
    assert scores.law_form(row)
    unseen["law"] = 0.15
    law |= {"site": "world", "name": "line_spring"}
    assert not scores.law_right(row) and not scores.law_helps(row) and not scores.law_form(row)
    law["alternatives"] = [{"name": "uneven_ripple_of_wheels"}]
    assert scores.law_form(row), "in the set that the data cannot tell apart"
    silent = record("cogging_wheel", {"verdict": "unknown", "proposal": None})
    assert scores.law_proposed(silent) is False and scores.law_right(silent) is False
    assert scores.law_helps(silent) is False
    unseen["base"] = 0.021
    assert scores.law_helps(row) is None, "the base model's free run is hardly worse"
    assert scores.law_needless(row) is None
    # Where nothing is missing, or the catalogue has it, none is wanted.
    for what in ("", "floor_tilt"):
        named = record(what, {"proposal": law})
        assert scores.law_needless(named) is True and scores.law_proposed(named) is None
    table = scores.score([row | {"case": {**row["case"], "kind": "law"}}])["kinds"]["law"]
    assert table["law_proposed"]["count"] == 1


@pytest.mark.parametrize("name", effects.LAWS)
def test_what_is_outside_the_catalogue_acts_and_says_what_it_depends_on(name: str):
    case = cases.draw_case(name, 0, 3, rate=50.0, noise=0.0)
    item, planted = effects.EVERYTHING[name], cases.physics(case)
    assert item.site in ("body", "world", "wheel", "roller") and item.main_variables
    fields = item.plant(case.planted[0].values)
    assert set(fields) <= set(planted._fields)
    # The first one is its strength, which means none at zero.
    strength = next(iter(fields))
    assert getattr(planted, strength) != 0 and planted._field_defaults[strength] == 0


def test_the_true_platform_follows_its_own_torques():
    case = cases.draw_case("floor_tilt", 0, 3, rate=50.0, noise=0.0)
    log = cases.unseen_log(case)
    truth = trials.true_model(case)
    assert truth is not None
    (samples,) = Mecanum(truth.geometry, truth.structure).samples_of([log])
    run = (samples.wheel_speed, samples.torque, samples.dt, samples.pose[0])
    mine = cases.true_velocity_error(case, *run)
    # Nothing is left but the commands, held between two rows and drawn as a line.
    assert mine < 1e-3 and trials.velocity_error(truth, [log]) < 1e-3
    assert cases.true_velocity_error(cases.draw_case("none", 0, 3, rate=50.0), *run) > 0.1


def test_the_fall_of_the_error_is_measured_against_what_it_can_fall():
    steps = [{"velocity_error": 0.20}, {"velocity_error": 0.05}]
    row = record("tether", {"steps": steps}, true_velocity_error=0.03)
    expected = 1 - (0.05**2 - 0.03**2) / (0.20**2 - 0.03**2)
    assert scores.error_fall(row) == pytest.approx(expected)
    assert scores.error_fall(row | {"true_velocity_error": 0.19}) is None
    assert scores.error_fall(row | {"true_velocity_error": None}) is None


def test_a_tie_is_resolved_when_the_truth_stands_alone():
    tied = said("ambiguous", "floor_tilt", floor_tilt=["tether"])
    for after, resolved in ((said("effect", "tether"), True), (tied, False)):
        row = record("tether", tied, after=Answer(**after).report)
        assert scores.tie_resolved(row) is resolved
    assert scores.tie_resolved(record("tether", tied)) is None
    assert scores.tie_resolved(record("tether", said("effect", "tether"), after={})) is None


def test_sizes_are_judged_by_their_intervals():
    name = "wheel_coulomb_friction"
    for value, inside in ((0.21, True), (0.25, False)):
        stated = {f"{name}.torque": {"value": value, "std": 0.01}}
        assert scores.sizes_inside(record(name, sizes=stated)) == [inside]
    assert scores.sizes_inside(record(name, sizes={})) == []


def test_smallest_detectable_is_the_end_of_an_unbroken_row():
    rows = []
    for factor, hits in ((0.25, 2), (0.5, 1), (1.0, 2), (2.0, 2)):
        for k in range(2):
            row = record("tether", said("effect", "tether" if k < hits else "floor_tilt"))
            row["case"]["planted"][0]["factor"] = factor
            rows.append(row)
    assert scores.smallest_detectable(rows) == {"tether": 1.0}
    assert scores.smallest_detectable(rows[:4]) == {"tether": None}


def test_confusion_counts_answers_of_single_effects():
    rows = [
        record("tether", said("effect", "floor_tilt")),
        record("tether", said("unknown")),
        record("tether", said("unknown")),
        record("", said("adequate"), kind="none"),
        record("tether+floor_tilt", said("effect", "tether"), kind="two"),
    ]
    assert scores.confusion(rows) == {
        "none": {"adequate": 1},
        "tether": {"unknown": 2, "floor_tilt": 1},
    }


def test_sizes_at_a_ratio_are_read_between_those_tried():
    found = [(Sizing("tether", f, 0, 0), math.hypot(1.0, 8.0 * f)) for f in (0.25, 0.5, 1.0, 2.0)]
    row = size_table(found)["tether"]
    assert row["smallest"] == pytest.approx(row["size"] * math.sqrt(8.0) / 8.0, rel=1e-6)
    assert row["largest"] is None
