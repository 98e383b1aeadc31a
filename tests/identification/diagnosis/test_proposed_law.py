"""A law beyond the catalogue is judged as effects are, and effects that imitate it go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.diagnosis.candidates import fit_base, fit_structure, try_candidate
from identification.diagnosis.proposed_law import Fits, _worsens_free_run, propose
from identification.diagnosis.structures import LoggedData
from identification.fitting.final_fit import final_fit
from identification.mechanisms.registry import mechanism_of
from identification.proposal.law import FoundLaw
from identification.proposal.propose import with_law
from tests.identification.proposal.laws import every_law
from tests.identification.recordings import recording
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.plugins import load_effects


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def data_with(effects) -> LoggedData:
    return LoggedData(mechanism_of(load_model("paper")), [recording("calibration", effects)])


@pytest.mark.slow
def test_the_law_replaces_what_imitated_it(tmp_path: Path):
    law = next(law for law in every_law() if law.name == "dry_nap")
    planted = FoundLaw(law, {"force": 9.0, "smoothing": 0.01, "direction": 0.9})
    path = tmp_path / "nap.py"
    path.write_text(planted.file_text("Planted by a test."))
    load_effects(path)
    data = data_with((("dry_nap", (("force", 9.0),)),))
    # As on another machine, whose catalogue does not have it.
    del CATALOGUE._effects["dry_nap"]
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    drag = try_candidate(base, None, "cable_drag")[0]
    imitated = fit_structure(data, drag.mechanism, drag.theta)
    steps = (data.step(base, None), data.step(imitated, "cable_drag"))
    kept, found = propose(data, steps, True, Fits(fit_structure, final_fit))
    assert [step.effect for step in kept] == [None]
    assert found is not None and found.name == "dry_nap" and found.beside == ()
    floor = data.floor(base).to_dict()["force_error"]
    assert found.force_error < 1.3 * floor < 0.3 * steps[0].force_error
    assert found.velocity_error < 0.3 * steps[0].velocity_error
    assert found.share is not None and found.share > 0.9
    for name, value in (("force", 9.0), ("direction", 0.9)):
        low, high = found.parameters[name]["interval"]
        assert low - 0.02 * value < value < high + 0.02 * value
    assert "dry_nap" not in CATALOGUE


def test_nothing_is_proposed_beside_noise():
    data = data_with(())
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    steps = (data.step(base, None),)
    kept, found = propose(data, steps, False, Fits(fit_structure, final_fit))
    assert found is None and kept == steps
    assert np.isfinite(steps[0].force_error)


def test_a_law_that_makes_the_free_run_worse_is_none(monkeypatch):
    data = data_with(())
    paper = load_model("paper")
    base = fit_base(data, mechanism_of(paper), paper.theta)
    step = data.step(base, None)
    law = FoundLaw(next(law for law in every_law() if law.name == "dry_nap"), {})
    ripple = FoundLaw(next(law for law in every_law() if law.name == "ripple_of_wheels"), {})
    for found, refused in ((law, True), (ripple, False)):
        effect = found.effect()
        mechanism = with_law(base.mechanism, effect)
        theta = np.concatenate([base.theta, [effect.defaults[n] for n in effect.parameter_names]])
        fitted = replace(base, mechanism=mechanism, theta=theta)
        after = replace(step, fitted=fitted, effect=effect.name)
        worse = replace(after, velocity_error=2 * step.velocity_error)
        assert not _worsens_free_run(data, step, after)
        assert _worsens_free_run(data, step, worse) is refused
