"""The evaluation of controllers: closed loops, many of them, and the command around them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers import registry
from controllers.interface import Loop, Observation, Reference
from controllers.kinematic import Gains, KinematicControl
from controllers.registry import Entry
from tests.controllers.driving import Silent
from tests.scripts.test_reports import charts, stands_alone, visible
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.hardware import MAX_WHEEL_TORQUE
from youbot_scripts.cli import main
from youbot_scripts.evaluation import evaluation, tables
from youbot_scripts.evaluation.charts import controllers_chart, frequency_chart
from youbot_scripts.evaluation.conditions import (
    Condition,
    LoopSettings,
    ModelSource,
    PlantSource,
    ReferenceMotion,
    Settings,
)
from youbot_scripts.evaluation.evaluation import (
    EvaluationTrial,
    ModelTask,
    digest,
    learn,
    plan,
    run_all,
)
from youbot_scripts.evaluation.suites import SUITES, settings
from youbot_scripts.evaluation.summary import gather, headline, ratios, unscored

QUICK: dict[str, Any] = {
    "models": ("known",),
    "controllers": ("kinematic",),
    "bands": ((1.0, 2.0), (2.0, 4.0)),
    "seeds": 2,
    "duration": 2.0,
    "against": "kinematic",
}
ARGUMENTS = (
    *("evaluate", "--model", "known", "--bands", "1-2,2-4", "--seeds", "2", "--duration", "2"),
    *("--against", "kinematic", "--jobs", "1"),
)

MOTION = multisine(np.random.default_rng(0), band=(1.0, 3.0), duration=5.0)


def unstable(model: Model, loop: Loop) -> KinematicControl:
    """Gains that no loop with a delay stands."""
    return KinematicControl(model.geometry, Gains(60.0, 5000.0), 1e6, loop.sample_time)


@pytest.fixture
def controllers(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Entry], None]:
    """Adds controllers to the registry for one test."""
    return lambda name, entry: monkeypatch.setitem(registry.CONTROLLERS, name, entry)


# --- many ------------------------------------------------------------------------------------


def records(folder: Path | None = None, jobs: int = 1, **changes: Any) -> list[dict[str, Any]]:
    found = evaluation.evaluate(Settings(**{**QUICK, **changes}), jobs=jobs, folder=folder)
    return found.records


def test_processes_and_resumption_change_no_bit(tmp_path: Path):
    alone = records()
    kept = records(folder=tmp_path)
    results = tmp_path / "results.jsonl"
    lines = results.read_text().splitlines(keepends=True)
    results.write_text("".join(lines[:1]) + lines[1][:50])  # interrupted in the second
    assert records(folder=tmp_path, jobs=2) == kept == alone
    assert len(results.read_text().splitlines()) == len(lines) == 4


def test_a_folder_serves_many_settings_without_mixing_them(tmp_path: Path):
    first = records(folder=tmp_path)
    other = records(folder=tmp_path, delay=3)
    assert len((tmp_path / "results.jsonl").read_text().splitlines()) == 8
    assert not {r["key"] for r in first} & {r["key"] for r in other}
    assert records(folder=tmp_path) == first


def test_all_controllers_meet_the_same_references_and_noise(controllers):
    seen: list[list[tuple[Observation, Reference]]] = []

    class Witness(Silent):
        def reset(self) -> None:
            super().reset()
            seen.append(self.seen)

    for name in ("first", "second"):
        controllers(name, Entry(lambda model, loop: Witness(), "sees"))
    records(controllers=("first", "second"), bands=((1.0, 2.0),))
    one, other, next_seed, _ = seen
    for (a, reference), (b, same) in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.wheel_speed, b.wheel_speed)
        np.testing.assert_array_equal(reference.twist, same.twist)
    assert not np.array_equal(one[-1][1].twist, next_seed[-1][1].twist)
    noise = np.array([o.wheel_speed for o, _ in one]) - np.array(
        [o.wheel_speed for o, _ in next_seed]
    )
    assert noise.std() > 0.01  # two draws of 0.01 rad/s, on a platform that stands still


def test_a_controller_never_gets_the_plant(controllers):
    """What it is built on is the condition's model, however the plant differs from it."""
    built: list[Model] = []

    def build(model: Model, loop: Loop) -> Silent:
        built.append(model)
        return Silent()

    controllers("spy", Entry(build, "sees"))
    effects = ("floor_tilt:tilt_x=0.02",)
    records(controllers=("spy",), models=("paper", "known"), effects=effects, lag=0.03, seeds=1)
    believed = [tuple(model.effects) for model in built]
    assert set(believed) == {(), ("floor_tilt", "actuator_lag")}
    assert believed.count(()) == len(believed) / 2


def test_designs_are_made_once_for_a_model_and_a_loop_and_kept(controllers, tmp_path: Path):
    made: list[Loop] = []

    def design(model: Model, loop: Loop) -> dict[str, float]:
        made.append(loop)
        return {"proportional": 0.5, "integral": 0.25}

    def build(model: Model, loop: Loop, **settings: float) -> KinematicControl:
        return KinematicControl(model.geometry, Gains(**settings), sample_time=loop.sample_time)

    controllers("designed", Entry(build, "searched for", design))
    chosen = Settings(**{**QUICK, "controllers": ("designed",), "delay": 3})
    for _ in range(2):
        found = evaluation.evaluate(chosen, folder=tmp_path)
        assert [design["settings"] for design in found.to_dict()["designs"]] == [
            {"proportional": 0.5, "integral": 0.25}
        ]
    assert [(loop.delay, loop.measurement_delay) for loop in made] == [(0.03, 0.005)]


# --- models ----------------------------------------------------------------------------------


def test_an_identified_model_is_close_to_the_plant_and_kept(tmp_path: Path):
    condition = Condition(PlantSource(lag=0.03), ModelSource("identified"), LoopSettings())
    truth = condition.plant.truth.values
    first = learn([condition], 0, folder=tmp_path)[condition]
    for name, size in {"m0": 0.02, "I0": 0.02, "mu1": 0.01, "mu2": 0.01}.items():
        assert first.values[name] == pytest.approx(truth[name], rel=size)
        assert first.values[name] != truth[name]
    assert first.values["actuator_lag.time_constant"] == pytest.approx(0.03, abs=0.002)
    before = (tmp_path / "models" / "results.jsonl").stat().st_mtime_ns
    again = learn([condition], 0, folder=tmp_path)[condition]
    assert again.values == first.values
    assert (tmp_path / "models" / "results.jsonl").stat().st_mtime_ns == before


@pytest.mark.slow
def test_the_loop_closes():
    """Diagnosed, the hidden slope no longer disturbs computed torque."""
    chosen = Settings(
        effects=("floor_tilt:tilt_x=-0.018,tilt_y=-0.004",),
        models=("identified", "diagnosed"),
        controllers=("computed_torque",),
        bands=((0.5, 3.0),),
        seeds=2,
    )
    before, after = (result.mean("nrmse") for result in evaluation.evaluate(chosen, jobs=2).results)
    assert after < before / 3


def test_no_log_knows_of_a_surprise():
    plain = PlantSource(effects=("floor_tilt:tilt_x=0.01",))
    surprised = replace(plain, surprises=("payload_change:mass=5,time=3",))
    assert surprised.recorded == plain.recorded
    assert tuple(surprised.truth.effects) == ("floor_tilt", "payload_change")
    know = ModelSource("identified")
    assert ModelTask(surprised, know, 0).key == ModelTask(plain, know, 0).key
    loop = LoopSettings()
    trials = [
        EvaluationTrial(
            Condition(p, know, loop), "kinematic", plain.truth, ReferenceMotion((1.0, 2.0)), 0, 0
        )
        for p in (plain, surprised)
    ]
    assert trials[0].key != trials[1].key
    first, second = (trial.trace().twist for trial in trials)
    np.testing.assert_allclose(first[:300], second[:300], rtol=0, atol=1e-12)
    assert np.abs(first[300:] - second[300:]).max() > 1e-3


def test_the_contact_plant_takes_part():
    """Another engine's physics: near the model's, and not the same."""
    pytest.importorskip("mujoco")
    quick: dict[str, Any] = {"bands": ((1.0, 2.0),), "seeds": 1}
    ideal, rolling = records(**quick), records(plants=("contact",), **quick)
    assert rolling[0]["nrmse"] != ideal[0]["nrmse"]
    np.testing.assert_allclose(rolling[0]["nrmse"], ideal[0]["nrmse"], rtol=0.1)


def test_settings_that_nothing_can_be_learnt_from_are_refused():
    for how in ("identifed", "nowhere.json", "identified+magic"):
        with pytest.raises(InputError):
            ModelSource(how)


# --- results ---------------------------------------------------------------------------------


def record(controller: str, seed: int, size: float, **changes: Any) -> dict[str, Any]:
    """A trial's record whose errors are ``size``, twice that on VY."""
    condition = Condition(PlantSource(), ModelSource("known"), LoopSettings()).to_dict()
    numbers = {name: [size, 2 * size, size] for name in ("rmse", "nrmse", "worst")}
    others = ("position_drift", "heading_drift", "effort", "torque_rate")
    return {
        **{"key": f"{controller}{seed}", **condition, "controller": controller, "band": [1.0, 2.0]},
        **{"seed": seed, "diverged": None, "saturation": 0.0, **numbers},
        **dict.fromkeys(others, 1.0),
        "course": [size, 2 * size],
        **changes,
    }


def test_a_diverged_run_is_shown_and_never_averaged_away():
    lost = {"key": "x", "diverged": 1.0}
    sound = record("a", 0, 0.1)
    kept = {k: v for k, v in sound.items() if not isinstance(v, float) and k != "nrmse"}
    results = gather([sound, {**kept, **lost, "seed": 1}, record("b", 0, 0.2)])
    assert (results[0].runs, results[0].diverged) == (2, 1)
    assert np.isnan(results[0].mean("nrmse VX")) and np.isnan(ratios(results, "b")[1.0, 2.0]["a"])
    shown = "\n".join(
        " ".join(map(str, row)) for t in tables.tables(results, "b") for row in t.rows
    )
    assert "a 1/2 diverge" in shown
    assert "a diverges" in " ".join(tables.overview(results, "b").notes)
    told = headline(results, "b")
    assert "b tracks best: it misses the reference by 26.7 % on average; a diverges" in told
    assert "no controller follows every band; a diverges" in headline(results[:1], "b")
    figure: Any = controllers_chart("c", results).figure
    assert figure.layout.yaxis.ticktext == ("a (diverges)", "b")
    assert np.isnan(figure.data[0].x[0]) and figure.data[0].x[1] == pytest.approx(26.67, abs=0.01)


def test_the_course_is_shown_where_something_changes_in_the_runs():
    plant = PlantSource(surprises=("payload_change:mass=5,time=10",))
    place = Condition(plant, ModelSource("known"), LoopSettings()).to_dict()
    for changes, wanted in ((place, True), ({}, False)):
        found = tables.tables(gather([record("a", 0, 0.1, **changes)]), "a")
        shown = [table for table in found if "over the time" in table.title]
        assert bool(shown) == wanted
        if shown:
            assert shown[0].rows == (("1-2", "0-5", "10"), ("", "5-10", "20"))


def test_models_of_one_plant_stand_side_by_side():
    other = {"model": "diagnosed"}
    results = gather([record("a", 0, 0.3), record("a", 0, 0.03, **other)])
    figure: Any = frequency_chart("f", results).figure
    lines = figure.data[:2]
    assert [line.line.dash for line in lines] == ["dash", "solid"], "the last model's is solid"
    found = tables.tables(results, "a")
    assert found[0].headers == ("rad/s", "controller", "known", "diagnosed")
    assert found[0].rows == (("1-2", "a", "40.0", "4.00"),)


@pytest.mark.parametrize(
    ("models", "heads"),
    [
        (("runs/old/a.json", "runs/new/b.json"), ("a.json", "b.json")),
        (("runs/old/a.json", "runs/new/a.json"), ("runs/old/a.json", "runs/new/a.json")),
    ],
)
def test_columns_of_models_are_as_short_as_tells_them_apart(models, heads):
    results = gather([record("a", 0, 0.3, model=model) for model in models])
    found = tables.by_model(results)
    assert found.headers == ("rad/s", "controller", *heads)
    assert ", ".join(models) in found.heading


def test_ratios_are_those_of_the_worst_axis():
    other = record("b", 0, 0.1)
    other["nrmse"] = [0.1, 0.1, 0.1]
    results = gather([record("a", 0, 0.1), other])
    assert ratios(results, "b")[1.0, 2.0] == {"a": pytest.approx(2.0), "b": 1.0}
    assert ratios(results, "a")[1.0, 2.0]["b"] == pytest.approx(1.0)


def test_what_saturates_is_shown_but_not_scored():
    results = gather([record("a", 0, 0.1), record("b", 0, 0.1, saturation=0.25)])
    assert unscored(results) == {(1.0, 2.0): "b saturates 25.0 % of the time"}
    assert "not scored" in tables.overview(results, "a").notes[0]
    assert unscored(results[:1]) == {}


def test_a_torque_beyond_the_limit_saturates(controllers):
    controllers("greedy", Entry(lambda model, loop: Silent(torque=9.0), "wants too much"))
    found = records(controllers=("greedy", "kinematic"), seeds=1)
    assert [r["saturation"] for r in found] == [1.0, 0.0, 1.0, 0.0]
    assert found[0]["effort"] == pytest.approx(MAX_WHEEL_TORQUE)


def test_a_key_stands_for_everything_that_a_result_depends_on():
    model = PlantSource().truth
    base = Condition(PlantSource(), ModelSource("known"), LoopSettings())
    courses = [
        ReferenceMotion((1.0, 2.0)),
        ReferenceMotion((1.0, 2.0), duration=21.0),
        ReferenceMotion((1.0, 2.1)),
    ]
    conditions = [
        base,
        Condition(PlantSource(lag=0.03), base.model_source, base.loop),
        Condition(PlantSource(effects=("floor_tilt:tilt_x=0.01",)), base.model_source, base.loop),
        Condition(base.plant, base.model_source, LoopSettings(noise=0.02)),
        Condition(base.plant, base.model_source, LoopSettings(pose=True)),
    ]
    for models in (model, model.with_values({"m0": 36.0})):
        found = plan(dict.fromkeys(conditions, models), ["kinematic"], courses, 0, 2)
        assert len({trial.key for trial in found}) == len(conditions) * len(courses) * 2
    assert digest("a", 1) != digest("a", 2)


# --- the command -----------------------------------------------------------------------------


def test_the_command_prints_tables_and_writes_everything(controllers, tmp_path: Path, capsys):
    controllers("unstable", Entry(unstable, "falls over"))
    files = {name: str(tmp_path / name) for name in ("out.json", "out.html", "plots")}
    status = main(
        [*ARGUMENTS, "--controllers", "kinematic,unstable", "--json", files["out.json"]]
        + ["--report", files["out.html"], "--plots", files["plots"]]
    )
    printed = capsys.readouterr()
    assert status == 0, printed.err
    assert "plant paper, model known; 100 Hz, delay 1 sample" in printed.out
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["seed"] == 0 and found["version"] and len(found["trials"]) == 8
    assert found["conditions"][0]["believed"] == found["conditions"][0]["truth"]
    errors = [r["metrics"]["nrmse VX"]["mean"] for r in found["results"][::2]]
    assert 0.1 < errors[0] < errors[1] < 1.0
    pictures = {path.name for path in (tmp_path / "plots").glob("*.png")}
    assert pictures == {"error_by_frequency.png", "time_courses.png"}
    page = (tmp_path / "out.html").read_text()
    assert stands_alone(page)
    assert charts(page) == {"frequency", "controllers", "costs", "course", "torques"}
    text = visible(page)
    assert "kinematic tracks best: it misses the reference by" in text
    assert text.index("tracks best") < text.index("Normalised RMSE by axis")


def brief(folder: Path, models: str, capsys) -> tuple[str, list[str]]:
    """What `--brief` prints and draws, for the first band alone."""
    plots = str(folder / models)
    status = main(
        [*ARGUMENTS, "--controllers", "kinematic", "--bands", "1-2", "--model", models]
        + ["--effect", "floor_tilt:tilt_x=0.02", "--brief", "--plots", plots]
    )
    printed = capsys.readouterr()
    assert status == 0, printed.err
    return printed.out, sorted(path.stem for path in (folder / models).glob("*.png"))


def test_in_brief_there_is_one_table_and_one_picture_a_plant(tmp_path: Path, capsys):
    for models, picture in {
        "known": "error_by_frequency",
        "paper,known": "error_by_model",
    }.items():
        printed, pictures = brief(tmp_path, models, capsys)
        assert pictures == [picture]
        assert printed.count("Mean normalised") == 1
        assert "by axis" not in printed and "torque N m" not in printed


def test_a_picture_by_model_tells_the_models_apart():
    from youbot_scripts.evaluation.figures import error_by_frequency

    trials = [
        {**record("a", seed, size), "model": model}
        for model, size in {"first": 0.3, "second": 0.2, "third": 0.1}.items()
        for seed in (0, 1)
    ]
    figure = error_by_frequency(gather(trials))
    curves = [lines[0] for lines in figure.axes[0].containers]  # pyright: ignore[reportIndexIssue]
    heights = [float(curve.get_ydata()[0]) for curve in curves]
    assert heights == pytest.approx([30.0, 20.0, 10.0])
    assert [curve.get_linestyle() for curve in curves] == [":", "--", "-"]
    assert len({curve.get_color() for curve in curves}) == 1
    assert [text.get_text() for legend in figure.legends for text in legend.texts] == ["a"]
    stated = " ".join(" ".join(text.get_text() for text in figure.texts).split())
    assert "model first (dotted), second (dashed), third (solid)" in stated


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--controllers", "kinematik"], "did you mean kinematic"),
        (["--controllers", ","], "none is named"),
        (["--bands", "1-0.5"], "write for instance 0.5-1"),
        (["--bands", "a"], "write for instance 0.5-1"),
        (["--amplitude", "1,2"], "three numbers"),
        (["--amplitude", "1,2,nan"], "finite"),
        (["--plant", "nowhere.json"], "nowhere.json"),
        (["--model", "identifed"], "identified"),
        (["--effect", "flor_tilt"], "floor_tilt"),
        (["--suite", "papre"], "did you mean paper"),
        (["--lag", "-1"], "lag"),
        (["--rate", "0"], "rate"),
        (["--duration", "-3"], "duration"),
        (["--delay", "-1"], "delay"),
        (["--against", "pid"], "name one of kinematic"),
        (["--report", "/nowhere/at/all.html"], "does not exist"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments: list[str], says: str, capsys):
    assert main([*ARGUMENTS, "--controllers", "kinematic", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error and says in error


def test_a_folder_of_something_else_is_refused(tmp_path: Path, capsys):
    (tmp_path / "results.jsonl").write_text("{}\n")
    assert main([*ARGUMENTS, "--controllers", "kinematic", "--resume", str(tmp_path)]) == 2
    assert "row 1: " in (said := capsys.readouterr().err) and "name another folder" in said


def test_an_interruption_keeps_what_is_done_and_says_so(controllers, tmp_path: Path, capsys):
    calls = []

    def build(model: Model, loop: Loop) -> Silent:
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return Silent()

    controllers("interrupted", Entry(build, "stops"))
    chosen = ("--controllers", "interrupted", "--against", "interrupted")
    status = main([*ARGUMENTS, *chosen, "--resume", str(tmp_path)])
    assert status == 130 and "interrupted" in capsys.readouterr().err
    assert len((tmp_path / "results.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize("suite", SUITES)
def test_every_suite_can_be_run(suite: str):
    chosen = settings(suite, {"seeds": 1})
    assert chosen.seeds == 1 and chosen.conditions() and chosen.references()


def test_what_a_user_says_goes_before_the_suite():
    assert settings("late", {}).delay == 3
    assert settings("late", {"delay": 2, "lag": None}).delay == 2
    assert settings("late", {"delay": 2, "lag": None}).lag == 0.03


def test_run_all_keeps_the_order_of_the_tasks():
    condition = Condition(PlantSource(), ModelSource("known"), LoopSettings())
    courses = [ReferenceMotion((2.0, 4.0), duration=1.0), ReferenceMotion((1.0, 2.0), duration=1.0)]
    trials = plan({condition: condition.plant.truth}, ["kinematic"], courses, 0, 1)
    found = run_all([trials[1], trials[0], trials[1]], 1, None)
    assert [record["band"][0] for record in found] == [1.0, 2.0, 1.0]
