"""Structures of any mechanism: keys of caches, small when pickled, in the key of their kernels."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from typing import cast

import pytest

from identification.mechanisms.axis import AXIS
from youbot_env.errors import InputError
from youbot_env.physics.effect import BODY, CATALOGUE, WORLD, Body, World
from youbot_env.physics.mecanum import MECANUM, mecanum_structure
from youbot_env.physics.mechanism import EffectPoints, Instant, MechanismKind, ModelStructure
from youbot_env.physics.namespaces import floats
from youbot_env.simulation.generated_code import SOURCES

CASES = [
    pytest.param(MECANUM, ("wheel_coulomb_friction", "actuator_lag"), id="platform"),
    pytest.param(AXIS, ("spring", "actuator_lag"), id="axis"),
]


def of(kind: MechanismKind, effects: tuple[str, ...] = ()) -> ModelStructure:
    return ModelStructure(effects, kind)


@pytest.mark.parametrize(("kind", "effects"), CASES)
def test_equal_effects_make_equal_keys(kind: MechanismKind, effects: tuple[str, ...]):
    assert of(kind, effects) == of(kind, effects) != of(kind, effects[::-1])
    assert len({of(kind, effects), of(kind, effects), of(kind)}) == 2


def test_structures_of_two_mechanisms_differ():
    assert mecanum_structure() != of(AXIS)


@pytest.mark.parametrize(("kind", "effects"), CASES)
def test_theta_and_the_state_follow_the_effects(kind: MechanismKind, effects: tuple[str, ...]):
    bare, full = of(kind), of(kind, effects)
    added = full.parameter_names[len(bare.parameter_names) :]
    assert {name.split(".")[0] for name in added} == set(effects)
    assert full.slices[-1][1].stop == len(full.parameter_names)
    assert not bare.has_actuator and full.has_actuator
    assert full.state_names == bare.state_names + kind.drive_state
    assert bare.wrenches == bare.slices and full.wrenches == full.slices[:-1]


@pytest.mark.parametrize(("kind", "effects"), CASES)
def test_a_pickle_holds_names_and_finds_the_effects_again(
    kind: MechanismKind, effects: tuple[str, ...]
):
    structure = of(kind, effects)
    size = len(pickle.dumps(structure))
    assert structure.components[-1].name == effects[-1]  # what is worked out stays at home
    assert len(pickle.dumps(structure)) == size
    again = pickle.loads(pickle.dumps(structure))
    assert again == structure and again.components == structure.components


@pytest.mark.parametrize("kind", [MECANUM, AXIS])
def test_structures_refuse_what_cannot_be(kind: MechanismKind):
    name = kind.catalogue.names()[0]
    with pytest.raises(InputError, match="named twice"):
        of(kind, (name, name))
    with pytest.raises(InputError, match="unknown effect 'nothing'"):
        of(kind, ("nothing",))


def test_a_platform_holds_one_actuator(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(CATALOGUE._effects, "second_lag", CATALOGUE["actuator_lag"])
    with pytest.raises(InputError, match="one actuator effect"):
        mecanum_structure(("actuator_lag", "second_lag"))


def test_a_mass_that_acts_beyond_a_place_alone_is_not_smooth(monkeypatch: pytest.MonkeyPatch):
    """What an effect reads is seen wherever it is tried, also where it makes no difference."""
    declared = CATALOGUE["wheel_coulomb_friction"]

    def sledge(xp, wheel, torque, smoothing):
        return torque * xp.where(wheel.contact.x > 1e3, wheel.acceleration, 0.0 * wheel.rate)

    def unpacked(xp, wheel, torque, smoothing):
        rate, *_ = wheel
        return torque * rate

    for function in (sledge, unpacked):
        item = replace(declared, name=function.__name__, function=function)
        monkeypatch.setitem(CATALOGUE._effects, item.name, item)
    found = mecanum_structure(("sledge", "unpacked", declared.name)).smooth_components
    assert declared.name in found and not {"sledge", "unpacked"} & found


def test_points_of_one_motion_share_what_the_motion_decides():
    at = Instant((0.3, 0.1, 0.2), (0.5, 0.4, 0.7), (0.0, 1.0, 0.6))
    points = EffectPoints(floats, MECANUM, MECANUM.geometry, [1.0] * 7, at)
    moved = points.at_theta([2.0] * 7)
    asked = list[object]()

    def of_motion(one: EffectPoints) -> float:
        asked.append(one)
        return one.at.twist[0]

    assert points.once(of_motion) == moved.once(of_motion) == 0.3 and len(asked) == 1
    # The base parameters are no part of it.
    first, second = (cast(Body, one.of(BODY)[0]) for one in (points, moved))
    assert first.base.m0 == 1.0 and second.base.m0 == 2.0
    here, there = (cast(World, one.of(WORLD)[0]) for one in (points, moved))
    assert here.velocity_x == there.velocity_x


@pytest.mark.parametrize("kind", [MECANUM, AXIS])
def test_the_key_of_a_kernel_reads_what_orders_its_arguments(kind: MechanismKind):
    """A changed order of theta or of the state must not meet a kernel of the old one."""
    homes = {ModelStructure.__module__, MechanismKind.__module__, kind.module}
    assert homes <= {*SOURCES, kind.module} <= set(sys.modules)


@pytest.mark.parametrize("kind", [MECANUM, AXIS])
def test_a_kind_of_mechanism_is_pickled_by_its_name(kind: MechanismKind):
    assert pickle.loads(pickle.dumps(kind)) is kind
