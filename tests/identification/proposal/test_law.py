"""Every law of the grammar is an effect like those of the catalogue, and so is its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from identification.proposal.products import products
from tests.identification.proposal.laws import SETTINGS, at_some_size, every_law, seen
from youbot_env.equations.equations import try_out
from youbot_env.physics.effect import CATALOGUE, WORLD
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import MECANUM
from youbot_env.physics.mechanism import EffectPoints, Instant, component_force
from youbot_env.physics.namespaces import floats
from youbot_env.plugins import load_effects

LAWS = every_law()


@pytest.fixture(autouse=True)
def catalogue(monkeypatch: pytest.MonkeyPatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))


def some_motion(n: int = 40) -> Instant:
    rng = np.random.default_rng(3)

    def draw(count: int, size: float) -> tuple[np.ndarray, ...]:
        return tuple(size * rng.standard_normal((count, n)))

    return Instant(
        *(draw(3, 0.3), draw(3, 0.3), draw(3, 1.0), draw(4, 5.0), draw(4, 0.5)),
        time=rng.uniform(0.0, 60.0, n),
    )


def force(effect, values, at, xp: Any = np):
    theta = [35.0, 4.4, 0.5, -0.7, 0.006, 0.11, 0.0058]
    points = EffectPoints(xp, MECANUM, Geometry(), theta, at)
    return np.array(np.broadcast_arrays(*component_force(effect, values, points))), points


def test_names_tell_all_laws_apart():
    names = [law.name for law in LAWS]
    assert len(set(names)) == len(names) > 150
    assert not set(names) & set(CATALOGUE.names())


@pytest.mark.parametrize(
    "factor",
    [law for law in LAWS if law.terms <= SETTINGS.max_factor_terms and law.place is WORLD],
    ids=lambda law: law.name,
)
def test_any_law_of_the_world_in_a_part_of_the_motion_is_itself_there(factor):
    """Whatever names its lines and constants have."""
    at = some_motion()
    known = at_some_size(factor)
    effect = known.effect()
    whole, _ = force(effect, [known.values[n] for n in effect.parameter_names], at)
    parts = list(products(factor, seen(), SETTINGS))
    assert len(parts) > 3
    for law in parts:
        found = replace(at_some_size(law), values={**at_some_size(law).values, **known.values})
        effect = found.effect()
        part, _ = force(effect, [found.values[n] for n in effect.parameter_names], at)
        acts = np.abs(whole) > 1e-9
        share = part[acts] / whole[acts]
        assert share.min() > -1e-9 and share.max() < 1 + 1e-9
        # The same share of each component.
        inside = (part * whole).sum(axis=0) / np.maximum((whole * whole).sum(axis=0), 1e-300)
        np.testing.assert_allclose(part, inside * whole, atol=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_is_linear_in_its_strengths_and_the_same_on_floats(law):
    found = at_some_size(law)
    effect, at = found.effect(), some_motion()
    values = np.array([found.values[name] for name in effect.parameter_names])
    shapes = np.array([effect.parameter(name).is_shape for name in effect.parameter_names])
    once, _ = force(effect, values, at)
    twice, _ = force(effect, np.where(shapes, values, 2 * values), at)
    none, _ = force(effect, np.where(shapes, values, 0.0), at)
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-12, atol=1e-15)
    assert np.abs(once).max() > 0 and not none.any()
    first = Instant(
        *(tuple(float(part[0]) for part in getattr(at, name)) for name in MOTION),
        time=float(np.asarray(at.time)[0]),
    )
    np.testing.assert_allclose(force(effect, values, first, floats)[0], once[:, 0], rtol=1e-9)


MOTION = ("twist", "acceleration", "pose", "wheel_angle", "torque")


@pytest.mark.parametrize("law", [law for law in LAWS if law.dissipative], ids=lambda law: law.name)
def test_friction_never_adds_energy(law):
    found = at_some_size(law)
    effect, at = found.effect(), some_motion()
    values = [found.values[name] for name in effect.parameter_names]
    power = sum(f * v for f, v in zip(force(effect, values, at)[0], at.twist, strict=True))
    assert np.min(power) >= -1e-12


SOME = [*LAWS[::12], *(law for law in LAWS if law.own_clock)]


@pytest.mark.parametrize("law", SOME, ids=lambda law: law.name)
def test_its_file_is_the_same_effect(law, tmp_path: Path):
    found = at_some_size(law)
    path = tmp_path / "law.py"
    path.write_text(found.file_text("Proposed by a test."))
    (loaded,) = load_effects(path)  # tries it out on numbers and on symbols
    effect, at = found.effect(), some_motion()
    assert loaded.name == effect.name and loaded.parameter_names == effect.parameter_names
    assert loaded.dissipative == law.dissipative and loaded.acts_at is law.place
    assert loaded.own_clock == law.own_clock
    values = [found.values[name] for name in effect.parameter_names]
    np.testing.assert_array_equal(force(loaded, values, at)[0], force(effect, values, at)[0])


def test_lines_of_its_file_are_as_long_as_a_person_writes_them():
    for law in LAWS:
        lines = at_some_size(law).file_text("Proposed by a test.").splitlines()
        assert max(map(len, lines)) <= 100, law.name


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_has_a_formula_on_symbols(law):
    try_out(at_some_size(law).effect())


def test_shape_constants_are_written_where_they_were_found(tmp_path: Path):
    law = next(law for law in LAWS if law.name == "dry_nap")
    found = at_some_size(law)
    moved = type(found)(law, {**found.values, "direction": 2.281369, "force": 10.78})
    path = tmp_path / "nap.py"
    path.write_text(moved.file_text("Proposed by a test."))
    (loaded,) = load_effects(path)
    assert loaded.parameter("direction").default == pytest.approx(2.281369, abs=1e-5)
    # So that whoever adds it fits the direction too.
    assert loaded.parameter("direction").grid and not loaded.parameter("smoothing").grid
    assert loaded.parameter("force").size == 11.0
