"""A proposal in words, as JSON, and as a file."""

from __future__ import annotations

import ast
import json
from dataclasses import replace

import pytest

from identification.mechanisms.physical_parameters import StatedParameters
from identification.mechanisms.registry import mechanism_of
from identification.proposal.law import Verdict
from identification.proposal.proposal import Proposal, sizes_in_words
from tests.identification.proposal.laws import at_some_size, every_law
from youbot_env.model.model import Estimate
from youbot_env.model.model_file import load_model


def proposal_of(name: str, **about) -> Proposal:
    found = at_some_size(next(law for law in every_law() if law.name == name))
    entries = {
        key: {"value": value, "unit": "N", "std": 0.1, "interval": [value - 0.2, value + 0.2]}
        for key, value in found.values.items()
    }
    other = at_some_size(every_law()[0])
    verdict = Verdict(
        *(found, 0.9, 0.8, 0.002, 0.001, (170, 900), ((found, 0.1),), ((other, 0.11),))
    )
    paper = load_model("paper")
    structure = {"mechanism": mechanism_of(paper), "theta": paper.theta}
    joint = StatedParameters(paper.parameters, {}, {})
    floor = {"force_error": 0.01, "velocity_error": 0.015}
    given = {"share": 0.87, "logs": ("a", "b"), "noise_floor": floor, "joint": joint}
    given |= {**structure, **about}
    return Proposal(found, entries, 0.012, 0.02, verdict=verdict, **given)


def fitted_with(law: str, effect: str, error: float = 0.012, **values: float) -> StatedParameters:
    """Parameters of a fit of the paper's model with an effect and a law that no catalogue has."""
    model = load_model("paper").with_effect(effect, **values)
    entries = {name: replace(entry, std=0.001) for name, entry in model.effects[effect].items()}
    effects = {effect: entries, law: {"force": Estimate(1.0, "N", 0.1)}}
    errors = {"force_error": error, "noise_floor": {"force_error": 0.0119}}
    return StatedParameters(model.parameters, effects, errors)


def test_its_json_holds_what_is_promised():
    found = json.loads(json.dumps(proposal_of("dry_nap").to_dict()))
    assert found["name"] == "dry_nap" and found["site"] == "world"
    assert found["variables"] == ["twist", "heading"] and found["file"] is None
    assert found["formula"].startswith("f tanh(v_d/eps)") and "\\tanh" in found["latex"]
    assert found["force_error"] == 0.012 and found["velocity_error"] == 0.02
    assert set(found["parameters"]) == {"force", "smoothing", "direction"}
    assert found["pareto"][0]["left"] == 0.1 and found["tried"] == {"laws": 170, "choices": 900}
    assert found["alternatives"][0]["left"] == 0.11
    ast.parse(found["source"])


def test_its_json_holds_all_else_that_is_fitted_with_it():
    joint = fitted_with("dry_nap", "uneven_wheel_friction", extra_bl=0.03)
    found = proposal_of("dry_nap", joint=joint).to_dict()["joint_fit"]
    assert set(found) == {"parameters", "effects"}
    assert set(found["parameters"]) == set(joint.parameters)
    assert set(found["effects"]) == {"uneven_wheel_friction"}, "the law's own stand beside it"
    wheel = found["effects"]["uneven_wheel_friction"]["parameters"]["extra_bl"]
    assert wheel["value"] == 0.03 and wheel["std"] == 0.001 and wheel["unit"] == "N m s"
    assert wheel["interval"] == pytest.approx([0.03 - 0.00196, 0.03 + 0.00196], rel=1e-4)
    # Where something is missing all the same, no interval holds.
    lacking = fitted_with("dry_nap", "uneven_wheel_friction", 0.02, extra_bl=0.03)
    found = proposal_of("dry_nap", joint=lacking).to_dict()["joint_fit"]["effects"]
    assert found["uneven_wheel_friction"]["parameters"]["extra_bl"]["interval"] is None


@pytest.mark.parametrize(
    ("name", "site"),
    [
        ("air_drag", "body"),
        ("at_peak_wheel_friction", "wheel"),
        ("quadratic_roller_friction", "roller"),
        ("ripple_of_floor", "world"),
    ],
)
def test_sites_have_the_words_of_the_contract(name, site):
    assert proposal_of(name).to_dict()["site"] == site


def test_its_words_say_what_where_how_large_how_sure_and_what_next():
    about = {"beside": ("floor_tilt",), "before": (0.08, 0.1)}
    first, second, third = proposal_of("dry_nap", **about).sentences
    assert first == (
        "proposed law: dry_nap (site world) takes 87% of what was missing: the force error falls "
        "from 8.00% to 1.20% and the velocity error falls from 10.00% to 2.00%, held out. In "
        "words: dry friction along one direction of the floor, beside floor_tilt; as a formula: "
        "f tanh(v_d/eps), v_d = vx cos(d) + vy sin(d) with force 1 N (0.8 to 1.2), "
        "smoothing 0.01 N (-0.19 to 0.21), direction 1.57 N (1.37 to 1.77)"
    )
    assert "0.1% of cases; these logs cannot tell it from" in second
    assert "to confirm, drive along that direction" in third
    worse = proposal_of("dry_nap", share=None, before=(0.08, 0.01)).sentences[0]
    assert "(site world): the force error falls" in worse and "velocity error is 2.00%" in worse


def test_an_interval_has_as_many_digits_as_tell_its_ends_apart():
    entry = {"value": 0.12, "unit": "N m s", "std": 2e-4, "interval": [0.1196, 0.1204]}
    wide, none = {**entry, "interval": [-0.2, 0.4]}, {**entry, "interval": None}
    told = sizes_in_words({"a": entry, "b": wide, "c": none})
    assert told == "a 0.12 N m s (0.1196 to 0.1204), b 0.12 N m s (-0.2 to 0.4), c 0.12 N m s"


def test_of_what_swings_it_says_when_each_log_began():
    about = {"starts": {"a": 0.0, "b": 1.25}, "of_clock": ("b began at 1.25 s",)}
    found = proposal_of("sway", **about)
    assert found.to_dict()["starts"] == {"a": 0.0, "b": 1.25}
    assert found.sentences[-1] == "b began at 1.25 s"
    assert proposal_of("dry_nap").to_dict()["starts"] == {}


def test_of_numbers_of_wheels_those_that_are_not_zero_are_said():
    found = proposal_of("uneven_dry_wheel_friction_by_angle_1")
    for name, entry in found.parameters.items():
        entry["value"] = 0.001 if name.endswith(("_fl", "_bl")) else 0.3
    first = found.sentences[0]
    assert "level_fr 0.3" in first and "level_fl" not in first and "near zero" in first


def test_its_file_says_where_it_comes_from():
    text = proposal_of("dry_nap", logs=tuple("abcdef")).file_text
    assert text.startswith('"""Proposed by youbot diagnose from a, b, c, d ...: 87% of what was')
    assert text.count("\n") < 30


def test_no_name_of_a_log_is_run_by_the_file():
    text = proposal_of("dry_nap", logs=('a"""\nimport os; """', "b\\")).file_text
    assert [type(node).__name__ for node in ast.parse(text).body] == [
        *("Expr", "ImportFrom", "FunctionDef")
    ]
    assert "import os" not in text.replace("import_os", "")
