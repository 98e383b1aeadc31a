"""Plants as they are named on the command line, and logs of one that rolls on real contacts."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from controllers.recording import record, run
from identification import compare, identify
from identification.logs.reading import read_log
from tests import test_readme
from youbot_env.contact.settings import Contact
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model, save_model
from youbot_env.motions.calibration import motion_iii
from youbot_env.motions.multisine import multisine
from youbot_env.simulation.plant import Plant
from youbot_scripts.cli import main
from youbot_scripts.recording.named_plants import Driven, plant_named

PAPER = load_model("paper")


class Torques:
    """A controller that plays torques and keeps what it was shown."""

    def __init__(self, torques: np.ndarray) -> None:
        self.torques, self.seen = torques, []

    def reset(self) -> None:
        self.seen = []

    def __call__(self, observation, reference):
        self.seen.append(observation)
        return self.torques[(len(self.seen) - 1) % len(self.torques)]


def test_a_name_says_model_effects_and_contacts(tmp_path: Path):
    assert plant_named("paper") == Driven(PAPER)
    assert (driven := plant_named("paper")).platform() is driven.model
    assert plant_named("contact") == Driven(PAPER, Contact())
    save_model(tmp_path / "m.json", PAPER.with_values({"m0": 40.0}))
    text = f"contact:friction=0.5, rollers=12,model={tmp_path / 'm.json'}"
    found = plant_named(text, ["floor_tilt:tilt_x=0.02"])
    assert found.contact == Contact(friction=0.5, rollers=12)
    assert found.model.values["m0"] == 40.0
    assert found.model.values["floor_tilt.tilt_x"] == 0.02
    told = json.loads(json.dumps(found.to_dict()))
    assert told["contact"] == {
        **{"friction": 0.5, "rollers": 12},
        **{"timestep": 0.001, "com_height": 0.1},
    }
    assert "contact" not in plant_named("paper").to_dict()


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("contact:", "'' is not SETTING=VALUE"),
        ("contact:grip=1", "'grip=1' is not SETTING=VALUE with one of model, friction"),
        ("contact:payload=5", r"payloads and dragging wheels are effects of the model \(--effect"),
        ("contact:friction", "'friction' is not SETTING=VALUE"),
        ("contact:friction=much", "friction=much is not a number"),
        ("contact:rollers=8.5", "rollers=8.5 is not a number"),
        ("contact:friction=-1", "contact friction: -1.0 must be positive"),
        ("contact:friction=nan", "contact friction"),
        ("contact:model=nowhere.json", "nowhere.json: no such file"),
        ("contacts", "contacts"),
    ],
)
def test_what_names_no_plant_is_one_line(text: str, fragment: str):
    with pytest.raises(InputError, match=fragment) as error:
        plant_named(text)
    assert "\n" not in str(error.value)


def test_a_plant_that_is_a_platform_moves_as_its_model_does():
    """The same course to the bit, whether the drive makes the plant or is given one."""
    motion, torques = motion_iii(duration=4.0, frequency=6.0), np.random.default_rng(0)
    played = torques.uniform(-1, 1, (37, 4))
    model = PAPER.with_effect("actuator_lag", time_constant=0.02)
    by_model = run(model, motion, Torques(played), rate=50)
    for _ in range(2):  # the second time from where the first has left it
        by_plant = run(plant := Plant(model, substeps=1), motion, Torques(played), rate=50)
        assert plant.state[10] == pytest.approx(
            by_model.trace.period * (len(by_model.trace.states) - 1)
        )
    assert by_plant.trace.states.shape == by_model.trace.states.shape
    np.testing.assert_allclose(by_plant.trace.states, by_model.trace.states, atol=1e-6)
    np.testing.assert_array_equal(by_plant.trace.command, by_model.trace.command)


def test_a_drive_measures_the_wheels_own_speeds_where_they_slip():
    pytest.importorskip("mujoco")
    plant = plant_named("contact:friction=0.02").platform()
    spy = Torques(np.full((1, 4), 1.5))
    found = run(plant, motion_iii(duration=3.0, frequency=8.0), spy, speed_noise=0.0)
    rolling = PAPER.geometry.wheel_speeds(found.trace.states[-1, :3])
    assert (found.trace.wheel_speed[-1] - rolling > 0.3).all()
    np.testing.assert_array_equal(found.trace.wheel_speed[-1], plant.wheel_rates[0])  # pyright: ignore
    np.testing.assert_array_equal(spy.seen[-1].pose, found.trace.states[-1, 3:6])


def test_a_controller_that_diverges_is_told():
    pytest.importorskip("mujoco")
    torques = np.ones((60, 4))
    torques[50:] = np.nan
    with pytest.raises(InputError, match=r"plant paper and its controller diverge at 0\.1 s"):
        run(
            plant_named("contact").platform(),
            motion_iii(duration=3.0, frequency=8.0),
            Torques(torques),
        )


def test_record_drives_it_and_one_seed_gives_the_same_bytes(tmp_path: Path, capsys):
    pytest.importorskip("mujoco")
    short = tmp_path / "short.json"
    description = motion_iii(duration=3.0, frequency=8.0).to_dict() | {"name": "short"}
    short.write_text(json.dumps(description))
    options = ["--plant", "contact:friction=0.6", "--effect", "floor_tilt:tilt_x=0.01"]
    for folder in "ab":
        arguments = ["record", str(tmp_path / folder), "--motions", str(short), *options]
        assert main([*arguments, "--effect", "actuator_lag:time_constant=0.02"]) == 0
    assert "Logs of paper with contacts" in capsys.readouterr().out
    for name in ("short.csv", "record.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    told = json.loads((tmp_path / "a" / "record.json").read_text())
    assert told["contact"]["friction"] == 0.6
    assert told["plant"]["effects"]["floor_tilt"]["parameters"]["tilt_x"]["value"] == 0.01
    log = read_log(tmp_path / "a" / "short.csv")
    # The encoders count over a period of the log: the speeds are means, and are said to be.
    warned = [f.message for f in log.findings if f.level != "info"]
    assert len(log) == 300 and all("means over as long" in message for message in warned)


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (["--effect", "tether"], "effect tether cannot be built with contacts"),
        (["--effect", "payload_change:mass=90,x=0.4,y=0,time=0"], "tips over"),
        (["--plant", "contact:friction=0"], "must be positive"),
    ],
)
def test_record_refuses_in_one_line_and_leaves_nothing(tmp_path, capsys, arguments, fragment):
    pytest.importorskip("mujoco")
    assert main(["record", str(tmp_path / "runs"), "--plant", "contact", *arguments]) == 2
    printed = capsys.readouterr()
    assert fragment in printed.err and printed.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_model_identified_from_its_logs_explains_other_logs_of_it():
    pytest.importorskip("mujoco")
    motions = [
        multisine(np.random.default_rng(k), duration=duration, name=f"multisine_{k}")
        for k, duration in ((0, 24.0), (1, 10.0))
    ]
    fitted, held_out = record(plant_named("contact").platform(), motions, seed=3)
    model = identify([fitted]).model
    v, true, R = model.values, PAPER.values, PAPER.geometry.R
    mass, expected = (values["m0"] + 4 * values["I1"] / R**2 for values in (v, true))
    error = compare(model, [held_out]).to_dict()["total"]
    print({name: round(v[name] / true[name], 3) for name in ("m0", "I0", "I1", "mu1", "mu2")})
    print(f"m0 + 4 I1/R^2 {mass:.2f} kg of {expected:.2f} kg, errors {error}")
    assert mass == pytest.approx(expected, rel=0.03)
    assert v["mu1"] == pytest.approx(true["mu1"], rel=0.02)
    assert v["mu2"] == pytest.approx(true["mu2"], rel=0.1)
    assert error["velocity_error"] < 0.05, "1 - 0.05^2 is 99.75 % of the variance"


@pytest.mark.slow
def test_the_document_s_commands_print_what_it_shows(tmp_path: Path, monkeypatch, capsys):
    pytest.importorskip("mujoco")
    document = (test_readme.ROOT / "docs" / "contact.md").read_text("utf-8")
    (console,) = re.findall(r"^```console\n(.*?)^```$", document, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    for step in test_readme._commands("contact", console):
        assert main(shlex.split(step.source)[1:]) == 0
        assert test_readme.first_missing(step.printed, capsys.readouterr().out) is None
