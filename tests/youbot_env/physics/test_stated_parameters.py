"""Parameters as people state them and as functions take them: there, back, and at no strength."""

from __future__ import annotations

import numpy as np
import pytest

from tests.youbot_env.structures import CASES, EFFECTS, catalogue_values, model
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model, save_model
from youbot_env.physics.effect import (
    BASE,
    BODY,
    CATALOGUE,
    Parameter,
    Public,
    effect,
    in_brackets,
    with_unit,
)
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.physics.namespaces import floats
from youbot_env.physics.stated_parameters import jacobian, public_parameters, to_public, to_theta
from youbot_env.plugins import load_effects
from youbot_scripts.shared.effect_tables import parameters

FORMED = [name for name in EFFECTS if CATALOGUE[name].public is not None]
OTHER = Geometry(l=0.2, h=0.3, R=0.06, r=0.011, m1=1.1)


@pytest.mark.parametrize("case", CASES)
def test_there_and_back_is_the_same(case: str):
    m = model(case)
    values = to_public(m.structure, OTHER, to_theta(m.structure, OTHER, m.values))
    assert values == pytest.approx(m.values, rel=1e-12)
    assert list(values) == list(public_parameters(m.structure, m.geometry))
    theta = m.theta * np.linspace(0.6, 1.4, len(m.theta))
    again = to_theta(m.structure, OTHER, to_public(m.structure, OTHER, theta))
    np.testing.assert_allclose(again, theta, rtol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_a_model_file_holds_what_people_state(case: str, tmp_path):
    m = model(case)
    save_model(tmp_path / "m.json", m)
    again = load_model(tmp_path / "m.json")
    assert again.values == m.values
    np.testing.assert_array_equal(again.theta, m.theta)
    assert set(m.values) == set(public_parameters(m.structure, m.geometry))


@pytest.mark.parametrize("name", FORMED)
def test_no_strength_has_no_place_and_no_error(name: str):
    item = CATALOGUE[name]
    stated = item.to_public(Geometry(), item.defaults.values())
    assert dict(zip(item.public_names, stated, strict=True)) == item.public_defaults
    without = load_model("paper").with_effect(name)
    assert np.isfinite(without.theta).all()
    assert np.isfinite(jacobian(without.structure, without.geometry, without.theta)).all()


def test_no_platform_without_its_wheels_has_no_centre_of_mass():
    paper = load_model("paper")
    wheels_alone = paper.theta.copy()
    wheels_alone[0] = 4 * paper.geometry.m1
    found = to_public(mecanum_structure(), paper.geometry, wheels_alone)
    assert found["aX"] == found["aY"] == 0.0


@pytest.mark.parametrize("case", CASES)
def test_jacobian_is_that_of_wider_differences(case: str):
    m = model(case)
    found = jacobian(m.structure, m.geometry, m.theta)
    names = list(public_parameters(m.structure, m.geometry))
    for k in range(len(m.theta)):
        step = 1e-4 * max(abs(m.theta[k]), 1e-3)
        ends = [m.theta + sign * step * np.eye(len(m.theta))[k] for sign in (1, -1)]
        ahead, behind = (to_public(m.structure, m.geometry, end) for end in ends)
        expected = np.array([ahead[name] - behind[name] for name in names]) / (2 * step)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=1e-5 * scale)


def test_jacobian_of_the_centre_of_mass_is_the_formula():
    m = load_model("paper")
    v, mass = m.values, m.values["m0"] - 4 * m.geometry.m1
    row = jacobian(m.structure, m.geometry, m.theta)[
        list(public_parameters(m.structure, m.geometry)).index("aX")
    ]
    assert row[2] == pytest.approx(1 / mass, rel=1e-8)
    assert row[0] == pytest.approx(-v["aX"] / mass, rel=1e-6)
    assert not row[[1, 3, 4, 5, 6]].any()


def test_jacobian_survives_the_wrap_of_a_phase():
    """At a phase of pi a small step to the other side changes it by two pi."""
    m = load_model("paper").with_effect("torque_ripple", amplitude=0.2, phase=np.pi)
    theta = m.theta.copy()
    where = m.structure.parameter_names.index("torque_ripple.cosine_fl")
    theta[where] = 0.0
    found = jacobian(m.structure, m.geometry, theta)
    phase = list(public_parameters(m.structure, m.geometry)).index("torque_ripple.phase_fl")
    assert found[phase, where] == pytest.approx(-1 / 0.2, rel=1e-6)


@pytest.mark.parametrize("name", FORMED)
def test_only_stated_parameters_are_spoken_of(name: str):
    item, paper = CATALOGUE[name], load_model("paper")
    hidden = set(item.parameter_names) - set(item.public_names)
    assert hidden and not hidden & {key.split(".")[-1] for key in model(name).values}
    with pytest.raises(InputError, match=f"no parameter '{min(hidden)}'; it has"):
        paper.with_effect(name, **{min(hidden): 1.0})
    stated = catalogue_values(name)
    assert model(name).values == paper.values | {f"{name}.{k}": v for k, v in stated.items()}


def test_the_base_is_one_user_of_the_form():
    (item,) = [item for item in BASE if item.public is not None]
    assert item.public_names == ("m0", "I0", "aX", "aY")
    assert item.to_internal(floats, OTHER, (30.0, 2.0, 0.1, -0.2)) == pytest.approx(
        (30.0, 2.0, 0.1 * (30 - 4.4), -0.2 * (30 - 4.4))
    )


# --- a user's own ----------------------------------------------------------------------------

MINE = '''
from youbot_env.physics.effect import BODY, Parameter, Public, effect


@effect(
    acts_at=BODY,
    parameters=[Parameter("drag", "N s/m", size=5.0), Parameter("drag_lever", "N s", size=1.0)],
    public=Public(
        parameters=(Parameter("drag", "N s/m", size=5.0), Parameter("lever", "m", size=0.2)),
        forward=lambda geometry, drag, drag_lever: (drag, drag_lever / drag if drag else 0.0),
        inverse=lambda xp, geometry, drag, lever: (drag, drag * lever),
    ),
    source="a user", recognise="A caster drags beside the middle.",
)
def caster(xp, body, drag, drag_lever):
    """Drag of a caster beside the middle [N]: d VX."""
    return drag * body.twist[0], 0.0, -drag_lever * body.twist[0]
'''


@pytest.fixture
def catalogue(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


@pytest.mark.usefixtures("catalogue")
def test_an_effect_of_ones_own_has_a_form_of_its_own(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    load_effects(tmp_path / "mine.py")
    m = load_model("paper").with_effect("caster", drag=4.0, lever=0.25)
    np.testing.assert_array_equal(m.theta[-2:], [4.0, 1.0])
    change = m.wrench((0.5, 0, 0), (0, 0, 0)) - load_model("paper").wrench((0.5, 0, 0), (0, 0, 0))
    np.testing.assert_allclose(change, [2.0, 0.0, -0.5])
    save_model(tmp_path / "m.json", m)
    assert load_model(tmp_path / "m.json").values == m.values


@pytest.mark.usefixtures("catalogue")
@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("(drag, drag * lever)", "(drag, 2 * drag * lever)", "inverse does not undo forward"),
        ("if drag else 0.0", "", "public form fails .ZeroDivisionError"),
        ("(drag, drag_lever / drag if drag else 0.0)", "(drag,)", "public form fails|one value"),
        ("lambda xp, geometry, drag, lever", "lambda geometry, drag, lever", "public form fails"),
    ],
)
def test_a_form_that_does_not_work_is_refused_in_words(right, wrong, message, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(MINE.replace(right, wrong))
    with pytest.raises(InputError, match=message):
        load_effects(path)
    assert "caster" not in CATALOGUE


@pytest.mark.usefixtures("catalogue")
def test_without_a_form_nothing_is_asked():
    @effect(
        acts_at=BODY, parameters=[Parameter("force", "N")], source="a test", recognise="A test."
    )
    def plain_force(xp, body, force):
        return force, 0.0, 0.0

    item = CATALOGUE["plain_force"]
    assert plain_force is item.function and item.public is None
    assert item.public_parameters is item.parameters and item.public_names == ("force",)
    assert isinstance(CATALOGUE["tether"].public, Public)


@pytest.mark.parametrize("item", list(CATALOGUE), ids=lambda item: item.name)
def test_a_plain_number_has_no_unit_where_it_is_said_or_listed(item):
    for known in item.public_parameters:
        said = known.fault(float("nan"))
        assert (
            said == f"{with_unit('nan', known.unit)} is outside [{known.lower:g}, {known.upper:g}]"
        )
        assert " 1 " not in said and in_brackets(known.name, known.unit).count("[1]") == 0
    assert "[1]" not in parameters(item)
