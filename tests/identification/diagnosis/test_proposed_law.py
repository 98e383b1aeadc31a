"""A law beyond the catalogue is judged as effects are, and effects that imitate it go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.comparison import compare
from identification.diagnosis import proposed_law
from identification.diagnosis.add_effect import add_effect
from identification.diagnosis.candidates import fit_base, fit_structure, try_candidate
from identification.diagnosis.diagnose import FITS, diagnose
from identification.diagnosis.proposed_law import _fitted, _worsens_free_run, propose
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import LoggedData, count_settled
from identification.fitting.errors import SumsOfSquares
from identification.fitting.identify import identify
from identification.logs.log import Log
from identification.mechanisms.registry import mechanism_of
from identification.proposal.law import FoundLaw
from identification.proposal.propose import Left, find_law, with_law
from tests.identification.proposal.laws import every_law
from tests.identification.recordings import recording
from youbot_env.errors import NoTorqueError
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.plugins import load_effects


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def data_with(effects) -> LoggedData:
    return LoggedData(mechanism_of(load_model("paper")), [recording("calibration", effects)])


def logs_with_a_nap(tmp_path: Path, *effects) -> list[Log]:
    """Logs of a platform on a carpet, by a machine whose catalogue has no nap."""
    law = next(law for law in every_law() if law.name == "dry_nap")
    planted = FoundLaw(law, {"force": 9.0, "smoothing": 0.01, "direction": 0.9})
    path = tmp_path / "nap.py"
    path.write_text(planted.file_text("Planted by a test."))
    load_effects(path)
    logs = [recording("calibration", (*effects, ("dry_nap", (("force", 9.0),))))]
    del CATALOGUE._effects["dry_nap"]
    return logs


def data_with_a_nap(tmp_path: Path, *effects) -> LoggedData:
    return LoggedData(mechanism_of(load_model("paper")), logs_with_a_nap(tmp_path, *effects))


@pytest.mark.slow
def test_the_law_replaces_what_imitated_it(tmp_path: Path):
    data = data_with_a_nap(tmp_path)
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    drag = try_candidate(base, None, "cable_drag")[0]
    imitated = fit_structure(data, drag.mechanism, drag.theta)
    steps = (data.step(base, None), data.step(imitated, "cable_drag"))
    kept, found = propose(data, steps, True, FITS)
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


@pytest.mark.slow
def test_of_accepted_effects_those_stay_that_are_material_beside_the_law(tmp_path: Path):
    """A wheel that drags is there; the cable that took a part of the carpet's nap is not."""
    data = data_with_a_nap(tmp_path, ("uneven_wheel_friction", (("extra_bl", 0.04),)))
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    steps = [data.step(base, None)]
    for name in ("uneven_wheel_friction", "cable_drag"):
        tried = try_candidate(steps[-1].fitted, None, name)[0]
        steps.append(data.step(fit_structure(data, tried.mechanism, tried.theta), name))
    kept, found = propose(data, tuple(steps), True, FITS)
    assert [step.effect for step in kept] == [None, "uneven_wheel_friction"]
    assert found is not None and found.name == "dry_nap"
    assert found.beside == ("uneven_wheel_friction",)
    assert found.parameters["force"]["value"] == pytest.approx(9.0, rel=0.05)


@pytest.mark.slow
def test_an_effect_beside_a_law_has_the_size_that_was_fitted_with_it(tmp_path: Path):
    """Without the law the wheel's drag holds a part of it: what is told is not what is written."""
    planted, name = 0.12, "uneven_wheel_friction"
    (log,) = logs_with_a_nap(tmp_path, (name, (("extra_bl", planted),)))
    found = diagnose(load_model("paper"), [log], effects=[name])
    assert found.verdict == "unknown" and found.missing == (name,)
    assert found.proposal is not None and found.proposal.name == "dry_nap"
    written, told = (m.effects[name]["extra_bl"] for m in (found.model, found.told))
    assert told.std is not None and abs(told.value - planted) < 3 * told.std < 0.01 * planted
    assert written.value > 1.2 * planted
    assert "dry_nap" in found.told.effects and "dry_nap" not in found.model.effects
    words = "\n".join(found.sentences)
    assert f"wheel drags: {told.value:.3f} N m s" in words
    without = words[words.index("`-o` writes") :]
    assert f"extra_bl {written.value:.3g} N m s" in without.splitlines()[0]
    said = found.to_dict()["proposal"]["joint_fit"]["effects"][name]["parameters"]["extra_bl"]
    assert said["value"] == told.value and said["interval"][0] < planted < said["interval"][1]


@pytest.mark.slow
def test_what_wheels_show_stays_beside_a_law_that_explains_most_of_the_forces(tmp_path: Path):
    """A wheel that is larger takes next to nothing of what a carpet's nap does to the forces."""
    name = "wheel_radius_error"
    larger = {"error_fl": 0.0223, "error_fr": -0.0075, "error_bl": -0.0074, "error_br": -0.0074}
    logs = logs_with_a_nap(tmp_path, (name, tuple(larger.items())))
    found = diagnose(load_model("paper"), logs, effects=[name])
    assert found.verdict == "unknown" and found.missing == (name,)
    assert found.proposal is not None and found.proposal.name == "dry_nap"
    assert found.proposal.beside == (name,) and found.explained_share is not None
    assert found.explained_share < DiagnosisSettings().min_explained_share
    assert found.proposal.force_error < 1.1 * found.noise_floor["force_error"]
    error = found.told.effects[name]["error_fl"]
    assert error.std is not None and error.value == pytest.approx(0.0223, abs=5e-4)
    assert "front left wheel is 3.0% larger" in found.sentences[0]
    assert not any("takes -" in line for line in found.sentences)


def test_of_the_first_steps_those_that_are_settled_are_counted():
    data = data_with(())
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    step = data.step(base, None)
    steps = [step, *(replace(step, effect=name) for name in ("creep", "tilt", "radius"))]
    assert count_settled(steps, ()) == 1
    assert count_settled(steps, {"creep", "radius"}) == 2
    assert count_settled(steps, {"creep", "tilt", "radius"}) == 4


def test_steps_are_judged_on_the_folds_of_a_law():
    data = data_with(())
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    own = data.step(base, None)
    fewer = own.folds[:-1]
    step = data.step(base, None, fewer)
    assert step.folds == fewer and step.force_error != own.force_error
    (again,) = data.judged_alike([step], own.folds)
    assert again.folds == own.folds and again.force_error == own.force_error
    assert data.judged_alike([step], fewer)[0] is step


def test_nothing_is_proposed_beside_noise():
    data = data_with(())
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    steps = (data.step(base, None),)
    kept, found = propose(data, steps, False, FITS)
    assert found is None and kept == steps
    assert np.isfinite(steps[0].force_error)


def test_a_law_with_which_no_torque_drives_the_motion_is_left_out(monkeypatch):
    data = data_with((("wheel_coulomb_friction", (("torque", 0.3),)),))
    base = fit_base(data, mechanism_of(load_model("paper")), load_model("paper").theta)
    steps = (data.step(base, None),)
    law = next(law for law in every_law() if law.name == "squared_load_wheel_torque")
    verdict = find_law(
        Left(base.mechanism, base.theta, base.free, 0.9),
        *(data.samples, 0, data.settings.proposal, data.settings.fit),
    )
    assert verdict is not None
    # As much as its bound lets it be: more than peaks of the torque can make up for.
    limit = law.constants[0].upper
    too_much = replace(verdict, found=FoundLaw(law, {"share": limit}))
    monkeypatch.setattr(proposed_law, "find_law", lambda *_: too_much)
    with pytest.raises(NoTorqueError):
        _fitted(data, base, too_much.found, FITS)
    assert propose(data, steps, True, FITS) == (steps, None)


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


@pytest.mark.slow
def test_what_swings_in_time_is_found_added_and_compared_on_a_log_of_any_phase(tmp_path: Path):
    law = next(law for law in every_law() if law.name == "sway")
    path = tmp_path / "sway.py"
    path.write_text(FoundLaw(law, {"period": 3.7}).file_text("Planted by a test."))
    load_effects(path)
    logs = []
    for motion, phase in (("calibration", 0.4), ("I", 2.9), ("III", 5.0)):
        c, s = np.cos(phase), np.sin(phase)
        sizes = {"sine_x": 7.0 * c, "cosine_x": 7.0 * s, "sine_y": -3.0 * c, "cosine_y": -3.0 * s}
        logs.append(recording(motion, (("sway", (*sizes.items(), ("period", 3.7))),)))
    known, new = logs[:2], logs[2]
    # As on another machine, whose catalogue does not have it.
    del CATALOGUE._effects["sway"]
    mechanism, theta = mechanism_of(load_model("paper")), load_model("paper").theta
    data = LoggedData(mechanism, known)
    base = fit_base(data, mechanism, theta)
    _, found = propose(data, (data.step(base, None),), True, FITS)
    assert found is not None and found.name == "sway"
    starts = list(found.starts.values())
    assert (starts[1] - starts[0]) % 3.7 == pytest.approx(3.7 * 2.5 / (2 * np.pi), abs=0.05)
    assert "is a number of that log" in found.sentences[-1]
    low, high = found.parameters["period"]["interval"]
    assert low - 0.005 < 3.7 < high + 0.005

    path = tmp_path / "law.py"
    path.write_text(found.file_text)
    load_effects(path)
    added = add_effect(load_model("paper"), "sway", known)
    # Without the calibration, motion I alone shows little of the platform.
    assert added.worthwhile and added.after.force_error < 0.5 * added.before.force_error
    plain = SumsOfSquares.of(compare(load_model("paper"), [new]).logs[0].velocity).ratio
    better = SumsOfSquares.of(compare(added.model, [new]).logs[0].velocity).ratio
    assert better < 0.2 * plain
    # And fitted again on logs of any phase.
    again = identify(logs, start=added.model).model
    assert again.effects["sway"]["period"].value == pytest.approx(3.7, rel=2e-3)
