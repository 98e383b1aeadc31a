"""What acts and nobody knows: a residual policy learns it, a proposed law states it."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import pytest

from identification.proposal.law import FoundLaw
from tests.identification.proposal.laws import every_law
from youbot_env.physics.effect import CATALOGUE
from youbot_scripts.cli import main

PLANT = "dry_nap:force=9,direction=0.7"
"""What is hidden in the logs of the demo's last room."""


@pytest.mark.slow
def test_a_law_beats_a_policy_that_learns_beneath_it(tmp_path: Path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    monkeypatch.chdir(tmp_path)
    law = next(item for item in every_law() if item.name == "dry_nap")
    found = FoundLaw(law, {"force": 9.0, "smoothing": 0.01, "direction": 0.69})
    Path("law.py").write_text(found.file_text("Proposed by a test."))
    folder = resources.files("youbot_scripts").joinpath("data", "carpet")
    logs = ["multisine_a.csv.gz", "IV.csv.gz"]
    for name in logs:
        Path(name).write_bytes(folder.joinpath(name).read_bytes())
    assert main(["identify", *logs, "-o", "base.json"]) == 0
    effects = ("--effects", "law.py")
    assert main(["add", "base.json", "dry_nap", *logs, *effects, "-o", "better.json"]) == 0
    plant = (*effects, "--effect", PLANT)
    assert main(["train", "ppo", "--residual", "computed_torque", "--model", "base.json", *plant,
                 "--steps", "50000", "--seed", "0", "--output", "residual"]) == 0  # fmt: skip
    assert main(["evaluate", *plant, "--model", "base.json,better.json", "--controllers",
                 "computed_torque,residual/policy.json", "--bands", "1-2", "--seeds", "2",
                 "--duration", "8", "--brief", "--jobs", "1",
                 "--json", "found.json"]) == 0  # fmt: skip
    errors: dict[tuple[str, str], float] = {}
    for row in json.loads(Path("found.json").read_text())["results"]:
        errors[row["controller"], row["model"]] = row["metrics"]["nrmse"]["mean"]
    blind = errors["computed_torque", "base.json"]
    learnt = min(value for (name, _), value in errors.items() if "policy" in name)
    stated = errors["computed_torque", "better.json"]
    assert learnt < blind, "the policy learns a part of it"
    assert stated < learnt / 5, "the law is all of it"
