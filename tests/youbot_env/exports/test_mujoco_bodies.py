"""The document is what the contact plant is built from, and leaves no effect out unsaid."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import pytest

from youbot_env import Contact, InputError, load_model, to_mjcf


def masses(text: str) -> float:
    """Mass of all bodies [kg]."""
    found = ElementTree.fromstring(text).iterfind(".//inertial")
    return sum(float(part.attrib["mass"]) for part in found)


def test_the_bodies_weigh_what_the_model_does():
    m = load_model("paper")
    assert masses(to_mjcf(m)) == pytest.approx(m.values["m0"], rel=1e-12)
    carrying = m.with_effect("payload_change", mass=5.0, x=0.05)
    assert masses(to_mjcf(carrying)) == pytest.approx(m.values["m0"], rel=1e-12)
    assert masses(to_mjcf(carrying, loaded=True)) == pytest.approx(m.values["m0"] + 5, rel=1e-12)


def test_settings_reach_the_document():
    joints = ElementTree.fromstring(to_mjcf("paper", Contact(rollers=6))).findall(".//joint")
    assert len(joints) == 4 + 4 * 6


def test_the_engine_reads_it():
    mujoco: Any = pytest.importorskip("mujoco")
    platform = mujoco.MjModel.from_xml_string(to_mjcf("paper"))
    assert [platform.actuator(k).trnid[0] for k in range(4)] == [
        platform.joint(name).id for name in ("fl", "fr", "bl", "br")
    ]


def test_effects_without_a_counterpart_are_refused():
    with pytest.raises(InputError, match="quadratic_friction cannot be built"):
        to_mjcf(load_model("paper").with_effect("quadratic_friction", coefficient=0.01))
