"""Laws of one axis: their files are effects of its catalogue, and what is missing is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.diagnosis.candidates import fit_base, fit_structure
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.structures import LoggedData
from identification.fitting.settings import FitSettings
from identification.logs.log import Log
from identification.mechanisms.axis import Axis
from identification.mechanisms.axis_effects import AXIS_CATALOGUE, UNITS, Scales, fitted_to
from identification.mechanisms.axis_model import base_axis_model
from identification.proposal.axis_laws import Travel, axis_laws
from identification.proposal.law import FoundLaw, Law
from identification.proposal.propose import Left, find_law, with_law
from identification.proposal.settings import ProposalSettings
from tests.identification.mechanisms.test_axis import STAGE, log_of, planted
from youbot_env import plugins
from youbot_env.errors import InputError
from youbot_env.plugins import load_effects

SCALES = Scales(False, 0.1, 0.3, 50.0, 0.33)
SETTINGS = ProposalSettings()
LAWS = axis_laws(Travel(SCALES, tuple(np.linspace(-0.15, 0.15, 9)), 40.0, 2e-4), SETTINGS)


@pytest.fixture
def kept_catalogue(monkeypatch):
    monkeypatch.setattr(AXIS_CATALOGUE, "_effects", dict(AXIS_CATALOGUE._effects))
    # Else each process that a later test starts would load the file too.
    monkeypatch.setattr(plugins, "_loaded", [])


def found(law: Law, **values: float) -> FoundLaw:
    whole = {c.name: values.get(c.name, c.values[0] if c.is_shape else 3.0) for c in law.constants}
    return FoundLaw(law, whole)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_its_file_is_an_effect_of_the_axis_catalogue(law: Law, tmp_path: Path, kept_catalogue):
    assert law.name not in AXIS_CATALOGUE and {c.unit for c in law.constants} <= set(UNITS)
    mine = found(law)
    path = tmp_path / f"{law.name}.py"
    path.write_text(mine.file_text("Proposed by a test."))
    (loaded,) = load_effects(path)
    assert AXIS_CATALOGUE[law.name] is loaded
    for made in (loaded, mine.effect()):
        # As the axis at hand declares it, shape constants are what was found.
        declared = fitted_to(made, SCALES)
        for constant in law.shapes:
            default = declared.parameter(constant.name).default
            assert default == pytest.approx(mine.values[constant.name], rel=1e-4)


def log_with(axis: Axis, theta: np.ndarray, law: Law, values: dict[str, float]) -> Log:
    """A log of an axis on which a law acts too."""
    more = with_law(axis, found(law, **values).effect())
    full = np.concatenate([theta, [values[c.name] for c in law.constants]])
    return log_of(more, full, rate=200.0, noise=0.01)  # type: ignore[arg-type]


def test_a_tight_spot_is_found_with_its_place_and_size():
    law = next(law for law in LAWS if law.name == "tight_spot")
    axis, theta = planted(STAGE)
    values = {"force": 12.0, "centre": 0.03, "width": 0.03, "smoothing": theta[3]}
    log = log_with(axis, theta, law, values)
    bare = Axis(axis.geometry)
    data = LoggedData(bare, [log])
    base = fit_base(data, bare, theta)
    left = Left(base.mechanism, base.theta, base.free, 0.9)
    said = find_law(left, data.samples, 0, SETTINGS, FitSettings())
    assert said is not None and said.found.law.name == "tight_spot"
    assert said.found.values["centre"] == pytest.approx(0.03, abs=0.003)
    assert said.found.values["force"] == pytest.approx(12.0, rel=0.1)
    clean = log_of(axis, theta, rate=200.0, noise=0.01)
    nothing = LoggedData(bare, [clean])
    base = fit_base(nothing, bare, theta)
    left = Left(base.mechanism, base.theta, base.free, 0.5)
    assert find_law(left, nothing.samples, 0, SETTINGS, FitSettings()) is None


def test_a_spring_beside_a_tight_spot_has_the_size_that_was_fitted_with_it():
    law = next(law for law in LAWS if law.name == "tight_spot")
    axis, theta = planted(STAGE, "spring")
    values = {"force": 12.0, "centre": 0.03, "width": 0.03, "smoothing": theta[3]}
    log = log_with(axis, theta, law, values)
    said = diagnose(base_axis_model([log], unit="m"), [log])
    assert said.missing == ("spring",) and said.proposal is not None
    assert said.proposal.name == "tight_spot" and said.proposal.beside == ("spring",)
    planted_size = theta[axis.parameter_names.index("spring.stiffness")]
    told, written = (m.effects["spring"]["stiffness"] for m in (said.told, said.model))
    assert told.std is not None and written.std is not None
    assert abs(told.value - planted_size) < 2 * told.std < 0.2 * written.std
    assert abs(written.value - planted_size) > 4 * abs(told.value - planted_size)
    assert f"(stiffness = {told.value:.3g} N/m)" in said.sentences[0]
    assert "in part, fitted with the proposed law" in said.sentences[0]
    assert said.sentences[1].endswith(f"writes: stiffness {written.value:.3g} N/m")
    assert [row["with"] for row in said.rows()][-2:] == ["spring", "tight_spot (proposed)"]


def test_a_gear_that_loses_where_it_drives_is_found():
    law = next(law for law in LAWS if law.name == "loss_while_driving")
    axis, theta = planted({**STAGE, "inertia": 900.0})
    values = {"share": 0.25, "smoothing": theta[3]}
    log = log_with(axis, theta, law, values)
    bare = Axis(axis.geometry)
    data = LoggedData(bare, [log])
    base = fit_base(data, bare, theta)
    left = Left(base.mechanism, base.theta, base.free, 0.9)
    said = find_law(left, data.samples, 0, SETTINGS, FitSettings())
    assert said is not None and said.found.law.name == "loss_while_driving"
    # The search makes one linear step; a fit from there ends at the size.
    full = with_law(bare, said.found.effect())
    start = np.concatenate([base.theta, [said.found.values[c.name] for c in law.constants]])
    fitted = fit_structure(data, full, start)
    share = fitted.theta[full.parameter_names.index("loss_while_driving.share")]
    assert share == pytest.approx(0.25, rel=0.1)


def test_a_users_file_of_an_axis_is_tried_out(tmp_path: Path, kept_catalogue):
    path = tmp_path / "mine.py"
    head = (
        "from identification.mechanisms.axis_effects import AXIS_CATALOGUE, JOINT\n"
        "from youbot_env import Parameter, effect\n"
        "@effect(acts_at=JOINT, registry=AXIS_CATALOGUE, parameters=[Parameter('f', 'N')],\n"
        "        source='me', recognise='so')\n"
        "def mine(xp, joint, f):\n"
    )
    path.write_text(head + "    return f * xp.sqrt(xp.abs(joint.rate))\n")
    (effect,) = load_effects(path)
    assert effect.name == "mine" and "mine" in AXIS_CATALOGUE
    path.write_text(head.replace("mine", "theirs") + "    return f if joint.rate > 0 else -f\n")
    with pytest.raises(InputError, match="fails on symbols"):
        load_effects(path)
    assert "theirs" not in AXIS_CATALOGUE, "taken back"
