"""diagnose and add on recordings with a hidden effect, and on given logs."""

import json

import numpy as np
import pytest

import identification
from controllers.recording import record
from identification.diagnosis.add_effect import add_effect
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.settings import DiagnosisSettings
from identification.logs.reading import read_log
from tests.identification.shared_data import DATA, needs_data
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration
from youbot_env.motions.multisine import multisine
from youbot_env.physics.effect import BODY, CATALOGUE, Effect, Parameter

PAPER = load_model("paper")


def logs_of(effects: dict[str, dict[str, float]], seed: int = 1):
    plant = PAPER
    for name, values in effects.items():
        plant = plant.with_effect(name, **values)
    motions = [calibration(), multisine(np.random.default_rng(seed), name="multisine")]
    return record(plant, motions, rate=50.0, seed=seed)


def test_nothing_missing_is_adequate_and_the_numbers_repeat_to_the_bit():
    logs = logs_of({})
    first, second = (diagnose(PAPER, logs, seed=3).to_dict() for _ in range(2))
    assert first["verdict"] == "adequate" and first["missing"] == []
    assert json.dumps(first) == json.dumps(second)
    assert first["settings"] == DiagnosisSettings().to_dict()
    floor = first["noise_floor"]
    assert first["steps"][0]["force_error"] == pytest.approx(floor["force_error"], rel=0.1)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("wheel_coulomb_friction", {"torque": 0.25}),
        pytest.param("actuator_lag", {"time_constant": 0.06}, marks=pytest.mark.slow),
        pytest.param("floor_tilt", {"tilt_x": -0.018, "tilt_y": 0.006}, marks=pytest.mark.slow),
        pytest.param("uneven_wheel_friction", {"extra_bl": 0.08}, marks=pytest.mark.slow),
        pytest.param("quadratic_friction", {"coefficient": 0.01}, marks=pytest.mark.slow),
    ],
)
def test_a_hidden_effect_is_named_sized_and_takes_the_error_to_the_floor(name, values):
    result = diagnose(PAPER, logs_of({name: values}))
    found = result.to_dict()
    named = {*found["missing"][:1], *found["ambiguous_with"].get(found["missing"][0], [])}
    assert name in named
    first, last = found["steps"][0], found["steps"][-1]
    assert first["force_error"] > 2.0 * last["force_error"]
    assert last["force_error"] < 1.2 * found["noise_floor"]["force_error"]
    assert last["velocity_error"] < 1.3 * found["noise_floor"]["velocity_error"]
    if found["missing"] == [name]:
        for key, value in values.items():
            estimate = result.model.effects[name][key]
            assert abs(estimate.value - value) < max(4 * estimate.std, 0.05 * abs(value))


@pytest.mark.slow
def test_two_effects_are_both_found_and_coulomb_is_not_called_stribeck():
    planted = {"wheel_coulomb_friction": {"torque": 0.25}, "floor_tilt": {"tilt_x": 0.015}}
    found = diagnose(PAPER, logs_of(planted)).to_dict()
    assert set(found["missing"]) == set(planted)
    errors = [step["force_error"] for step in found["steps"]]
    assert errors == sorted(errors, reverse=True)


@pytest.mark.slow
def test_json_has_the_keys_of_the_design():
    found = diagnose(PAPER, logs_of({"floor_tilt": {"tilt_x": 0.018}})).to_dict()
    assert set(found) >= {
        "verdict", "missing", "ambiguous_with", "steps", "given_model", "noise_floor",
        "candidates", "where", "remaining", "next_experiment", "warnings",
    }  # fmt: skip
    assert found["steps"][0]["effect"] is None
    errors = [row["force_error"] for row in found["candidates"]]
    assert errors == sorted(errors)
    assert set(found["candidates"][0]["parameters"]) == {"tilt_x", "tilt_y"}
    assert "floor falls" in found["words"][0]


@pytest.mark.slow
def test_only_changed_parameters_are_adequate_with_a_warning():
    heavier = PAPER.with_values({"m0": 45.0, "mu1": 0.2})
    found = diagnose(heavier, logs_of({})).to_dict()
    assert found["verdict"] == "adequate"
    assert found["given_model"]["force_error"] > 3 * found["steps"][0]["force_error"]
    assert any("changed" in warning for warning in found["warnings"])


@pytest.fixture
def wind():
    """A user's own effect: a steady push along the body's X axis."""

    def steady_push(xp, body, force):
        return force + 0.0 * body.twist[0], 0.0, 0.0

    push = Effect(
        "steady_push",
        BODY,
        steady_push,
        (Parameter("force", "N", size=3.0),),
        source="test",
        recognise="The robot creeps to one side.",
    )
    CATALOGUE.add(push)
    yield "steady_push"
    CATALOGUE._effects.pop("steady_push")


@pytest.mark.slow
def test_a_users_effect_takes_part_and_wins_where_it_is_true(wind):
    found = diagnose(PAPER, logs_of({wind: {"force": 3.0}})).to_dict()
    assert found["missing"][0] == wind
    assert found["candidates"][0]["parameters"]["force"]["value"] == pytest.approx(3.0, rel=0.05)


@pytest.mark.slow
def test_adding_what_is_there_is_worth_it_and_what_is_not_there_is_not():
    logs = logs_of({"wheel_coulomb_friction": {"torque": 0.25}})
    good = add_effect(PAPER, "wheel_coulomb_friction", logs)
    assert good.worthwhile
    assert good.after.force_error < 0.3 * good.before.force_error
    useless = add_effect(good.model, "roller_inertia", logs)
    assert not useless.worthwhile and useless.reasons
    assert "roller_inertia" in useless.model.effects  # asked for, so it is done


def test_what_cannot_be_added_is_said_in_a_line():
    logs = logs_of({})
    with pytest.raises(InputError, match="unknown effect"):
        add_effect(PAPER, "magic", logs)
    with pytest.raises(InputError, match="already"):
        add_effect(PAPER.with_effect("floor_tilt"), "floor_tilt", logs)
    with pytest.raises(InputError, match="at least one"):
        diagnose(PAPER, [])


def test_functions_of_the_package_are_the_commands():
    assert identification.diagnose is diagnose
    assert identification.add_effect is add_effect


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "missing"),
    [
        ("wheel_coulomb_friction", ["wheel_coulomb_friction"]),
        ("floor_tilt", ["floor_tilt"]),
        ("uneven_wheel_friction", ["uneven_wheel_friction"]),
        ("actuator_lag", ["actuator_lag"]),
        ("torque_ripple", ["torque_ripple"]),
        (
            "wheel_coulomb_friction_and_floor_tilt",
            ["wheel_coulomb_friction", "floor_tilt"],
        ),
        ("nominal_1", []),
    ],
)
def test_given_platforms_are_diagnosed(folder, missing):
    logs = [read_log(path) for path in sorted((DATA / folder).glob("*.csv"))]
    found = diagnose(PAPER, logs)
    assert list(found.missing) == missing
    assert found.verdict in ("effect", "ambiguous") if missing else found.verdict == "adequate"


@needs_data
@pytest.mark.slow
def test_what_is_not_in_the_catalogue_is_unknown_and_its_variable_is_named():
    folder = DATA / "unknown_carpet_nap"
    found = diagnose(PAPER, [read_log(path) for path in sorted(folder.glob("*.csv"))])
    assert found.verdict == "unknown" and len(found.missing) <= 1
    beyond = [row["variable"] for row in found.where if row["variable"] != "twist"]
    assert "heading" in beyond[:2]


@needs_data
@pytest.mark.slow
def test_dry_friction_of_the_contact_simulator_is_named_and_sized():
    folder = DATA / "mujoco_wheel_frictionloss"
    found = diagnose(PAPER, [read_log(path) for path in sorted(folder.glob("*.csv"))])
    assert found.missing[0] == "wheel_coulomb_friction"
    size = found.model.effects["wheel_coulomb_friction"]["torque"].value
    assert size == pytest.approx(0.25, rel=0.2)
    nominal = DATA / "mujoco_nominal"
    clean = diagnose(PAPER, [read_log(path) for path in sorted(nominal.glob("*.csv"))])
    assert "wheel_coulomb_friction" not in clean.missing


@pytest.mark.slow
def test_wheels_that_slip_are_told_as_slip_and_no_law_is_sought():
    pytest.importorskip("mujoco")
    from youbot_env.contact.plant import ContactPlant
    from youbot_env.contact.settings import Contact

    plant = ContactPlant(PAPER, Contact(friction=0.08))
    found = diagnose(PAPER, record(plant, [calibration()], seed=1))
    content = found.to_dict()
    assert "slip" in content["headline"] and found.sentences[0].startswith("the wheels slip: ")
    assert content["slip"] > 0.01 and content["proposal"] is None
    assert not content["missing"]
