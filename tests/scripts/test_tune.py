"""`youbot tune`: what it prints and writes, and the gains files that others load."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from controllers import registry
from controllers.interface import Loop
from controllers.kinematic import Gains, KinematicControl
from controllers.pid.design import PIDGains
from controllers.tuning.gains_file import UNITS, load_gains, save_gains
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_scripts import cli

QUICK = ["--runs", "1", "--duration", "1", "--torque-rate", "1.5"]
PID_GAINS = PIDGains((9.0, 11.0, 10.0), 0.9, 0.03, 0.01)


def tune(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[str, dict]:
    assert cli.main(["tune", "paper", *QUICK, *map(str, arguments), "--json", "-"]) == 0
    out, err = capsys.readouterr()
    return err, json.loads(out)


def test_kinematic_gains_are_tuned_shown_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown, result = tune(capsys, "-o", tmp_path / "gains.json", "--seed", 4)
    best = result["results"]["tuned"]
    assert min(best["margins"]["gain_db"]) >= 6.0
    assert min(best["margins"]["phase_degrees"]) >= 45.0
    assert best["torque_rate"] <= 1.5 * (1 + 1e-9)
    errors = {name: one["mean_error"] for name, one in result["results"].items()}
    assert errors["free"] <= errors["any rate"] <= errors["tuned"] < errors["stock"] / 3
    assert result["seed"] == 4
    assert result["version"]
    gains = load_gains(tmp_path / "gains.json")
    assert isinstance(gains, Gains)
    assert gains.proportional == result["gains"]["proportional"]["value"]
    assert KinematicControl(gains=gains).preview_needed == 0
    for word in ("Margins of the tuned loop", "Slowest poles", "N m s/rad", "stock"):
        assert word in shown
    again, repeated = tune(capsys, "--seed", 4)
    assert {**repeated} == result, "the same seed gives the same numbers to the bit"


def test_pid_gains_are_tuned_under_lag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "gains.json"
    shown, result = tune(capsys, "--controller", "pid", "--lag", "0.03", "--delay", "3", "-o", path)
    gains = load_gains(path)
    assert isinstance(gains, PIDGains)
    assert gains.derivative_time == pytest.approx(0.03, rel=1e-6)
    assert min(result["results"]["tuned"]["margins"]["phase_degrees"]) >= 45.0
    assert result["loop"]["delay"] == pytest.approx(0.03)
    pytest.importorskip("control")
    assert "python-control" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--controller", "pid", "--lead"], "--lead: belongs to --controller kinematic"),
        (["--rate", "0"], "rate: 0.0 must be positive"),
        (["--delay", "-1"], "loop delay: -0.01 must be at least 0"),
        (["--runs", "1000", "--duration", "60"], "more than 2000 s of references"),
        (["--gain-margin", "150"], "no gains with .* keep gain margin >= 150 dB"),
        (["-o", "nowhere/gains.json"], "folder nowhere does not exist"),
    ],
)
def test_a_mistake_is_one_line(arguments, message, capsys: pytest.CaptureFixture[str]) -> None:
    import re

    assert cli.main(["tune", "paper", *QUICK, *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)


# --- gains files -----------------------------------------------------------------------------


@pytest.mark.parametrize("gains", [Gains(0.5, 4.0, 0.02), PID_GAINS], ids=["kinematic", "pid"])
def test_a_gains_file_gives_back_what_was_saved(gains, tmp_path: Path) -> None:
    path = tmp_path / "gains.json"
    save_gains(path, gains, loop={"delay": 0.01}, model="paper", provenance={"seed": 1})
    assert load_gains(path) == gains
    data = json.loads(path.read_text())
    assert {key: entry["unit"] for key, entry in data["gains"].items()} == UNITS[data["controller"]]


def test_a_gains_file_is_a_controller_by_its_name(tmp_path: Path) -> None:
    kinematic, pid = str(tmp_path / "kinematic.json"), str(tmp_path / "pid.json")
    save_gains(kinematic, Gains(0.5, 4.0))
    save_gains(pid, PID_GAINS)
    model, loop = load_model("paper"), Loop()
    assert registry.build(kinematic, model, loop).gains == Gains(0.5, 4.0)  # pyright: ignore
    assert registry.build(pid, model, loop).gains == PID_GAINS  # pyright: ignore
    before = registry.fingerprint(kinematic)
    save_gains(kinematic, Gains(0.5, 5.0))
    assert before not in ("", registry.fingerprint(kinematic))


def broken(change) -> str:
    data = {
        "schema_version": 1,
        "controller": "kinematic",
        "gains": {"proportional": {"value": 0.5, "unit": "N m s/rad"}, "integral": 4.0, "lead": 0},
    }
    change(data)
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        (broken(lambda d: d.pop("gains")), "'gains' is missing"),
        (broken(lambda d: d.update(schema_version=9)), "schema_version is 9"),
        (broken(lambda d: d.update(controller="lqi")), "controller 'lqi' is none of kinematic"),
        (broken(lambda d: d.update(controller=["pid"])), "is none of kinematic, pid"),
        (broken(lambda d: d.update(extra=1)), "unknown key 'extra'"),
        (broken(lambda d: d["gains"].update(derivative=1)), "unknown 'derivative'"),
        (broken(lambda d: d["gains"].pop("lead")), "gains: 'lead' is missing"),
        (broken(lambda d: d["gains"].update(integral="4")), "gains.integral: 4 is not a finite"),
        (broken(lambda d: d["gains"].update(integral=-4)), "gain integral: -4 must be at least 0"),
        (
            broken(lambda d: d["gains"]["proportional"].update(unit="V")),
            "gains.proportional: unit 'V', expected 'N m s/rad'",
        ),
        (broken(lambda d: d.update(gains=[1])), "gains must be a JSON object"),
    ],
)
def test_a_bad_gains_file_is_refused_by_name(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "gains.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_gains(path)
    assert str(caught.value).startswith(f"{path}: ")
