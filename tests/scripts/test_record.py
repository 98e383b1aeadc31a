"""The command `youbot record`: files, reproducibility, interruption, and what it refuses."""

from __future__ import annotations

import gzip
import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from controllers.recording import record
from identification.logs.log import Log
from identification.logs.reading import read_log
from tests.scripts.processes import heed_interrupts
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict, save_model
from youbot_env.motions.calibration import motion_i, motion_iii
from youbot_scripts.cli import main
from youbot_scripts.recording.named_motions import DEFAULT_MOTIONS, motions_named

PAPER = load_model("paper")
QUICK = ("--motions", "multisine_q")
SHIPPED = Path(sys.modules[main.__module__].__file__ or "").parent / "data"


@pytest.fixture
def short_motion(tmp_path: Path) -> Path:
    path = tmp_path / "short.json"
    path.write_text(
        json.dumps(motion_iii(duration=4.0, frequency=6.0).to_dict() | {"name": "short"})
    )
    return path


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_seed_gives_the_same_bytes_and_another_one_others(tmp_path: Path):
    for folder, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert main(["record", str(tmp_path / folder), *QUICK, "--seed", seed]) == 0
    first, again, other = (files(tmp_path / folder) for folder in "abc")
    assert first == again
    assert set(first) == {"multisine_q.csv", "record.json"}
    assert first["multisine_q.csv"] != other["multisine_q.csv"]


def test_a_log_does_not_depend_on_the_other_motions():
    i, iii = motion_i(duration=3.0, frequency=8.0), motion_iii(duration=3.0, frequency=8.0)
    alone, beside = record(PAPER, [iii]), record(PAPER, [i, iii])
    np.testing.assert_array_equal(alone[0].velocity, beside[1].velocity)
    np.testing.assert_array_equal(alone[0].effort, beside[1].effort)
    noise = alone[0].effort - record(PAPER, [iii], seed=1)[0].effort
    assert np.std(noise) == pytest.approx(0.03 * 2**0.5, rel=0.1)


def test_the_default_is_the_paper_s_calibration_and_two_multisines(tmp_path: Path, capsys):
    before = time.perf_counter()
    assert main(["record", str(tmp_path / "runs")]) == 0
    seconds = time.perf_counter() - before
    printed = capsys.readouterr()
    assert printed.err == ""
    assert f"Next: youbot identify {tmp_path}/runs/calibration.csv -o model.json" in printed.out
    assert seconds < 40.0, "4 s on an idle machine"
    names = {"calibration": 14000, "multisine_a": 6400, "multisine_b": 6400}
    for name, rows in names.items():
        assert f"{name}.csv" in printed.out
        log = read_log(tmp_path / "runs" / f"{name}.csv")
        assert len(log) == rows and log.rate == pytest.approx(100.0)
        assert [f for f in log.findings if f.level != "info"] == []
        assert log.pose is not None
        assert 5.0 < np.abs(log.velocity).max() < 12.5
    a, b = (read_log(tmp_path / "runs" / f"multisine_{x}.csv") for x in "ab")
    assert abs(np.corrcoef(a.velocity[:, 0], b.velocity[:, 0])[0, 1]) < 0.5
    # Two periods of 30.5 s between ramps of 1.5 s: what differs is noise, and the controller's lag.
    early, late = a.velocity[300:3200], a.velocity[3350:6250]
    assert np.std(late - early) < 0.03 * np.std(early)


@pytest.mark.parametrize("rate", [20.0, 50.0, 250.0, 333.0, 1000.0])
def test_a_log_of_any_rate_is_read_without_a_repair(tmp_path: Path, short_motion: Path, rate):
    options = ["--motions", str(short_motion), "--rate", f"{rate:g}"]
    assert main(["record", str(tmp_path), *options]) == 0
    log = read_log(tmp_path / "short.csv")
    assert log.rate == pytest.approx(rate, rel=1e-4)
    assert [f for f in log.findings if f.level in ("error", "repaired")] == []


@pytest.mark.parametrize("format", ["csv", "csv.gz", "parquet"])
def test_formats(tmp_path: Path, short_motion: Path, format: str):
    if format == "parquet":
        pytest.importorskip("pyarrow")
    arguments = ["record", str(tmp_path), "--motions", str(short_motion), "--format", format]
    assert main([*arguments, "--decimals", "4"]) == 0
    log = read_log(tmp_path / f"short.{format}")
    made = record(PAPER, [motion_iii(duration=4.0, frequency=6.0)])[0]
    assert log.velocity.shape == made.velocity.shape
    if format == "csv.gz":
        row = gzip.decompress((tmp_path / "short.csv.gz").read_bytes()).split(b"\n")[1]
        assert all(len(cell.split(b".")[1]) == 4 for cell in row.split(b","))


def test_record_json_tells_how_the_logs_were_made(tmp_path: Path, short_motion: Path):
    plant = tmp_path / "plant.json"
    save_model(plant, PAPER.with_effect("floor_tilt", tilt_x=0.02))
    result = tmp_path / "result.json"
    arguments = ["--plant", str(plant), "--motions", f"{short_motion},I", "--rate", "50"]
    noise = ["--torque-noise", "0.1", "--speed-noise", "0.02", "--seed", "7"]
    effect = ["--effect", "actuator_lag:time_constant=0.04", "--json", str(result)]
    assert main(["record", str(tmp_path / "runs"), *arguments, *noise, *effect]) == 0
    told = json.loads((tmp_path / "runs" / "record.json").read_text())
    assert told == json.loads(result.read_text())
    assert told["seed"] == 7 and told["version"] and "numpy" in told["versions"]
    assert told["settings"]["rate"] == 50 and told["settings"]["control_rate"] == 500
    assert told["settings"]["torque_noise"] == 0.1 and told["settings"]["speed_noise"] == 0.02
    assert [motion["name"] for motion in told["motions"]] == ["short", "I"]
    model = model_from_dict(told["plant"])
    assert model.values["floor_tilt.tilt_x"] == 0.02
    assert model.values["actuator_lag.time_constant"] == 0.04
    assert set(told["logs"]) == {"short.csv", "I.csv"}
    content = (tmp_path / "runs" / "I.csv").read_bytes()
    assert told["logs"]["I.csv"]["sha256"] == hashlib.sha256(content).hexdigest()
    assert told["logs"]["I.csv"]["rows"] == 35 * 50
    assert told["logs"]["I.csv"]["saturated"] == 0.0


def test_json_on_standard_output_is_nothing_but_json(tmp_path: Path, short_motion: Path, capsys):
    assert main(["record", str(tmp_path), "--motions", str(short_motion), "--json", "-"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["plant"] == model_to_dict(PAPER)
    assert "Next: youbot identify" in printed.err


def test_an_effect_by_name_alone_has_its_catalogue_size(tmp_path: Path, short_motion: Path):
    arguments = ["record", str(tmp_path), "--motions", str(short_motion)]
    assert main([*arguments, "--effect", "uneven_wheel_friction"]) == 0
    told = json.loads((tmp_path / "record.json").read_text())
    values = model_from_dict(told["plant"]).values
    assert values["uneven_wheel_friction.extra_fl"] == 0.1
    assert values["uneven_wheel_friction.extra_fr"] == 0.0


def test_a_saturated_loop_is_told(tmp_path: Path, capsys):
    heavy = tmp_path / "heavy.json"
    save_model(heavy, PAPER.with_values({"mu1": 0.6}))
    assert main(["record", str(tmp_path), "--plant", str(heavy), "--motions", "I"]) == 0
    told = json.loads((tmp_path / "record.json").read_text())["logs"]["I.csv"]
    assert told["peak_torque"] == pytest.approx(2.008, abs=1e-3)
    assert 0.02 < told["saturated"] < 0.9
    assert f"{100 * told['saturated']:.1f}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["--rate", "19"], "rate: 19 Hz is outside 20 to 1000 Hz"),
        (["--rate", "2000"], "rate: 2000 Hz is outside"),
        (["--rate", "nan"], "rate"),
        (["--rate", "fast"], "rate"),
        (["--plant", "nowhere.json"], "nowhere.json: no such file"),
        (["--motions", "V"], "motion 'V': not known"),
        (["--motions", ""], "motions: none is named"),
        (["--motions", "I,I"], "two are named 'I'"),
        (["--motions", "multisine/../../x"], "not known"),
        (["--motions", "gone.json"], "gone.json: cannot be read: No such file"),
        (["--motions", "BAD"], "bad.json: row 1, column 2: not valid JSON"),
        (["--motions", "EMPTY"], "empty.json: motion kind: None"),
        (["--motions", "EVIL"], "evil.json: motion name '../evil' cannot name a file"),
        (["--effect", "magic"], "unknown effect 'magic'"),
        (["--effect", "floor_tilt:tilt=1"], "no parameter 'tilt'"),
        (["--effect", "floor_tilt:tilt_x=steep"], "is not parameter=number"),
        (["--effect", "floor_tilt:tilt_x=nan"], "nan"),
        (["--effect", "floor_tilt:tilt_x=1"], "is outside"),
        (["--effect", "actuator_lag:time_constant=0"], "too stiff"),
        (["--torque-noise", "-1"], "torque noise: -1 must be at least 0"),
        (["--speed-noise", "inf"], "speed noise"),
        (["--format", "xlsx"], "format"),
        (["--seed", "-1"], "seed"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line(tmp_path: Path, capsys, arguments, fragment):
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "empty.json").write_text("{}")
    evil = motion_iii(duration=4.0, frequency=6.0).to_dict() | {"name": "../evil"}
    (tmp_path / "evil.json").write_text(json.dumps(evil))
    names = {name.upper(): f"{tmp_path}/{name}.json" for name in ("bad", "empty", "evil")}
    arguments = [names.get(argument, argument) for argument in arguments]
    assert main(["record", str(tmp_path / "runs"), *QUICK, *arguments]) == 2
    printed = capsys.readouterr()
    assert fragment in printed.err
    assert printed.err.count("\n") == 1 and printed.out == ""
    assert not list(tmp_path.glob("runs/*")), "nothing is left behind"


def test_an_output_that_is_a_file_is_one_line(tmp_path: Path, capsys):
    (tmp_path / "runs").touch()
    assert main(["record", str(tmp_path / "runs"), *QUICK]) == 2
    assert "runs: cannot be made a folder: File exists" in capsys.readouterr().err


def test_negative_noise_is_refused_from_python_too():
    with pytest.raises(InputError, match="torque noise"):
        record(PAPER, [motion_iii(duration=3.0, frequency=8.0)], torque_noise=-0.1)
    assert isinstance(
        record(PAPER, [motion_iii(duration=3.0, frequency=8.0)], torque_noise=0.0)[0], Log
    )


def test_ctrl_c_keeps_the_logs_that_are_finished(tmp_path: Path, short_motion: Path):
    code = "import sys; from youbot_scripts.cli import main; sys.exit(main(sys.argv[1:]))"
    arguments = ["record", str(tmp_path / "runs"), "--motions", f"{short_motion},calibration"]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments, "--rate", "1000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    told = tmp_path / "runs" / "record.json"
    deadline = time.monotonic() + 60
    while not told.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (out, err, process.returncode) == ("", "youbot: interrupted\n", 130)
    assert set(files(tmp_path / "runs")) == {"short.csv", "record.json"}
    assert len(read_log(tmp_path / "runs" / "short.csv")) == 4000
    assert set(json.loads(told.read_text())["logs"]) == {"short.csv"}


def test_the_shipped_logs_are_what_their_command_makes():
    told = json.loads((SHIPPED / "record.json").read_text())
    assert set(told["logs"]) == {path.name for path in SHIPPED.glob("*.csv.gz")}
    assert sum(path.stat().st_size for path in SHIPPED.glob("*.csv.gz")) < 700_000
    motions = motions_named(DEFAULT_MOTIONS, PAPER.geometry, 1)
    for made in record(PAPER, motions, rate=50.0, seed=1):
        shipped = read_log(SHIPPED / f"{made.name}.csv.gz")
        assert shipped.sha256 == told["logs"][f"{made.name}.csv.gz"]["sha256"]
        assert [f for f in shipped.findings if f.level != "info"] == []
        for kind in ("time", "velocity", "effort", "pose"):
            np.testing.assert_allclose(getattr(shipped, kind), getattr(made, kind), atol=6e-5)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["I.csv", "calibration.csv", "multisine_a.csv"], ["calibration.csv"]),
        (["I.csv", "II.csv", "multisine_a.csv"], ["I.csv", "II.csv"]),
        (["multisine_a.csv", "multisine_b.csv"], ["multisine_a.csv", "multisine_b.csv"]),
    ],
)
def test_what_to_identify_next_is_what_shows_the_parameters(names, expected):
    from youbot_scripts.record import to_fit

    assert to_fit(names) == expected
