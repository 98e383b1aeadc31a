"""A proposal in words, as JSON, and as a file."""

from __future__ import annotations

import ast
import json

import pytest

from identification.mechanisms.registry import mechanism_of
from identification.proposal.law import Verdict
from identification.proposal.proposal import Proposal
from tests.identification.proposal.laws import at_some_size, every_law
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
    given = {"share": 0.87, "logs": ("a", "b"), **structure, **about}
    return Proposal(found, entries, 0.012, 0.02, verdict=verdict, **given)


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


def test_its_words_say_what_where_how_sure_and_what_next():
    first, second, third = proposal_of("dry_nap", beside=("floor_tilt",)).sentences
    assert "87% of what was missing" in first and "beside floor_tilt" in first
    assert "1.20%" in second and "0.1% of cases" in second
    assert "to confirm, drive along that direction" in third
    assert "what was missing" not in proposal_of("dry_nap", share=None).sentences[0]


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
