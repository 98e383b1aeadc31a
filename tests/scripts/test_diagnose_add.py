"""The commands diagnose and add as a user meets them, on the shipped logs with a hidden effect."""

import functools
import json
import sys
from importlib import import_module
from pathlib import Path

import pytest

from identification.diagnosis.diagnose import diagnose
from identification.logs.reading import write_log
from tests.identification.proposal.test_proposal import fitted_with, proposal_of
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_scripts import cli
from youbot_scripts.diagnose import next_lines

HIDDEN = Path(cli.__file__).parent / "data" / "hidden"
LOGS = [str(HIDDEN / "calibration.csv.gz"), str(HIDDEN / "multisine_a.csv.gz")]

TRUTH = {"tilt_x": -0.018, "tilt_y": -0.004}


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("diagnosed")
    model, result = folder / "better.json", folder / "diagnosis.json"
    files = ["-o", str(model), "--json", str(result), "--plots", str(folder / "plots")]
    status = cli.main(["diagnose", "paper", *LOGS, *files])
    assert status == 0
    return model, json.loads(result.read_text())


@pytest.mark.slow
def test_names_the_hidden_effect_and_the_error_falls_to_the_floor(diagnosed):
    _, found = diagnosed
    assert found["verdict"] == "effect" and found["missing"] == ["floor_tilt"]
    assert [step["effect"] for step in found["steps"]] == [None, "floor_tilt"]
    last, floor = found["steps"][-1], found["noise_floor"]
    for kind in ("force_error", "velocity_error"):
        assert last[kind] < 1.15 * floor[kind] < 0.3 * found["steps"][0][kind]
    assert found["candidates"][0]["effect"] == "floor_tilt"
    assert found["where"][1]["variable"] == "heading"
    assert found["seed"] == 0 and "version" in found


def test_the_written_model_has_the_size_within_its_interval(diagnosed):
    model = load_model(str(diagnosed[0]))
    for name, value in TRUTH.items():
        estimate = model.effects["floor_tilt"][name]
        assert estimate.std is not None
        assert abs(estimate.value - value) < 3 * estimate.std
    assert len(model.logs) == 2


def test_draws_the_fall_and_the_residual(diagnosed):
    plots = diagnosed[0].parent / "plots"
    names = {"errors", "residual"}
    assert {path.name for path in plots.iterdir()} == {
        f"{name}.{kind}" for name in names for kind in ("png", "svg")
    }
    words = (plots / "errors.svg").read_text()
    assert "<!-- with floor_tilt -->" in words and "<!-- the model, refitted -->" in words


@pytest.mark.parametrize(
    ("found", "files", "told"),
    [
        ({"missing": ["floor_tilt"]}, (Path("b.json"), None), "youbot compare b.json LOG..., with"),
        ({"missing": ["floor_tilt"]}, (None, None), "the same command with -o better.json writes"),
        ({"missing": ["a"], "next_experiment": {"name": "x"}}, (None, None), "--next-motion FILE"),
        (
            {"next_experiment": {"name": "x"}},
            (None, Path("n.json")),
            "youbot motions drive/ --next",
        ),
        ({"verdict": "adequate"}, (None, None), "youbot evaluate --model m.json"),
        ({"verdict": "unknown"}, (None, None), None),
    ],
)
def test_what_to_type_next(found, files, told):
    whole = {"verdict": "effect", "missing": [], "next_experiment": None, **found}
    lines = list(next_lines(whole, "m.json", *files))
    assert len(lines) == (told is not None) and (told is None or told in lines[0])


def test_adding_a_useless_effect_says_so_and_does_it(diagnosed, tmp_path, capsys):
    output = tmp_path / "more.json"
    arguments = ["add", str(diagnosed[0]), "roller_inertia", *LOGS, "-o", str(output)]
    assert cli.main(arguments) == 0
    assert "Not worth it" in capsys.readouterr().out
    assert set(load_model(str(output)).effects) == {"floor_tilt", "roller_inertia"}


@pytest.mark.slow
def test_a_base_beyond_what_can_be_has_a_model_all_the_same(tmp_path, capsys, monkeypatch):
    """A steep slope, and a catalogue that lacks it: the base takes it up as far as it can."""
    slope = ("floor_tilt", (("tilt_x", 0.0), ("tilt_y", -0.04)))
    log, output = tmp_path / "steep.csv", tmp_path / "better.json"
    write_log(log, recording("calibration", (slope,), rate=50.0, noise=2.0))
    few = functools.partial(diagnose, effects=["quadratic_friction"])
    monkeypatch.setattr(sys.modules[diagnose.__module__], "diagnose", few)
    result = tmp_path / "result.json"
    line = ["diagnose", "paper", str(log), "--json", str(result), "-o", str(output)]
    assert cli.main(line) == 0
    assert "Verdict: unknown" in capsys.readouterr().out
    assert json.loads(result.read_text())["verdict"] == "unknown"
    found = load_model(str(output))
    assert found.values["m0"] > 4 * found.geometry.m1


@pytest.mark.slow
def test_a_users_own_effect_takes_part(tmp_path, capsys):
    mine = tmp_path / "my_effects.py"
    mine.write_text(
        "from youbot_env import WORLD, Parameter, effect\n"
        "@effect(acts_at=WORLD, parameters=[Parameter('stiffness', 'N/m', size=5.0)],\n"
        "        source='mine', recognise='Pulls back to the line x = 0.')\n"
        "def line_spring(xp, world, stiffness):\n"
        "    return stiffness * world.x, 0.0 * world.x, 0.0 * world.x\n"
    )
    result = tmp_path / "result.json"
    try:
        status = cli.main(
            ["diagnose", "paper", *LOGS, "--effects", str(mine), "--json", str(result)]
        )
        assert status == 0
        names = [row["effect"] for row in json.loads(result.read_text())["candidates"]]
        assert "line_spring" in names and names[0] == "floor_tilt"
    finally:
        CATALOGUE._effects.pop("line_spring", None)


@pytest.mark.parametrize(
    "arguments",
    [
        ["diagnose", "nowhere.json", *LOGS],
        ["diagnose", "paper", "nowhere.csv"],
        ["diagnose", "paper", *LOGS, "--effects", "nowhere.py"],
        ["diagnose", "paper", *LOGS, "--mechanism", "axis"],
        ["add", "paper", "magic", *LOGS],
        ["add", "paper"],
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments, capsys):
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("youbot:") and "\n" not in error and "Traceback" not in error


def test_a_law_is_written_as_python_only(tmp_path, capsys):
    assert cli.main(["diagnose", "paper", *LOGS, "--proposal", str(tmp_path / "law.txt")]) == 2
    assert "let its name end in .py" in capsys.readouterr().err
    assert cli.main(["diagnose", "paper", *LOGS, "--proposal", str(tmp_path / "no" / "l.py")]) == 2
    assert "does not exist" in capsys.readouterr().err


@pytest.mark.slow
def test_where_no_law_is_proposed_no_file_is_written(tmp_path, capsys, monkeypatch):
    module = import_module("identification.diagnosis.diagnose")
    path, result = tmp_path / "law.py", tmp_path / "d.json"
    monkeypatch.setattr(module, "propose", lambda data, steps, unexplained, fits: (steps, None))
    arguments = ["diagnose", "paper", *LOGS, "--proposal", str(path), "--json", str(result)]
    assert cli.main(arguments) == 0
    assert "no law is proposed" in capsys.readouterr().out and not path.exists()
    assert json.loads(result.read_text())["proposal"] is None


def test_a_proposed_law_is_told_and_written(tmp_path, capsys, monkeypatch):
    module = import_module("identification.diagnosis.diagnose")
    # As fitted with the law; without it, the slope holds a part of that.
    joint = fitted_with("dry_nap", "floor_tilt", tilt_x=-0.011, tilt_y=-0.002)
    found = proposal_of("dry_nap", joint=joint)
    monkeypatch.setattr(module, "propose", lambda data, steps, unexplained, fits: (steps, found))
    path, result, base = tmp_path / "law.py", tmp_path / "d.json", tmp_path / "base.json"
    arguments = ["diagnose", "paper", *LOGS, "--proposal", str(path), "--json", str(result)]
    assert cli.main([*arguments, "-o", str(base)]) == 0
    out, said = capsys.readouterr(), json.loads(result.read_text())
    out = out.err if "Verdict" in out.err else out.out
    assert "Laws beyond the catalogue" in out and f"youbot add {base} dry_nap" in out
    assert "dry_nap (proposed)" in out and "fitted without the proposed law" in out
    in_part, both = said["words"][:2]
    assert in_part.startswith("in part, fitted with the proposed law: the floor falls by 0.64 ")
    assert both.startswith("floor_tilt with the proposed law: tilt_x -0.011 rad (")
    assert "without it, as in the model that `-o` writes: tilt_x -0.018" in both
    joint = said["proposal"]["joint_fit"]["effects"]["floor_tilt"]["parameters"]
    assert joint["tilt_x"]["value"] == -0.011
    # The contract: the written model and the candidates' sizes are fitted without the law.
    written = load_model(str(base)).effects["floor_tilt"]["tilt_x"].value
    assert written == pytest.approx(TRUTH["tilt_x"], abs=2e-3)
    assert said["candidates"][0]["parameters"]["tilt_x"]["value"] == written
    assert "with floor_tilt in it, without the proposed law" in out.replace("\n", " ")
    assert [step["effect"] for step in said["steps"]] == [None, "floor_tilt"]
    # With a proposal the verdict stays, or becomes, unknown.
    assert said["verdict"] == "unknown" and said["proposal"]["file"] == str(path)
    assert path.read_text() == found.file_text == said["proposal"]["source"]
