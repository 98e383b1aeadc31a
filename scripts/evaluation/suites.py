"""Named sets of settings, and settings from options of the command line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from controllers import registry
from youbot_env.errors import InputError
from youbot_scripts.evaluation.conditions import BASIC, WIDE, Band, Settings

SUITES: dict[str, Mapping[str, Any]] = {
    "paper": {},
    "prompt": {
        "models": ("known", "identified"),
        "controllers": (*BASIC, "adaptive", "kinematic_free"),
        "bands": WIDE,
    },
    "late": {
        "models": ("known", "identified"),
        "controllers": (*BASIC, "adaptive", "kinematic_free"),
        "bands": WIDE,
        "delay": 3,
        "lag": 0.03,
    },
    "saturated": {"bands": ((4.0, 8.0),), "amplitude": (0.4, 0.3, 1.0)},
    "payload": {
        "surprises": ("payload_change:mass=8,x=0.1,y=0.05,time=20",),
        "controllers": ("kinematic_tuned", "computed_torque", "adaptive"),
        "bands": WIDE,
        "duration": 45.0,
    },
    "tilt": {
        "effects": ("floor_tilt:tilt_x=-0.018,tilt_y=-0.004",),
        "models": ("identified", "diagnosed"),
        "bands": WIDE,
    },
    "contact": {"plants": ("contact",), "bands": WIDE, "delay": 3, "lag": 0.03},
    "coulomb": {
        "effects": ("wheel_coulomb_friction:torque=0.1",),
        "models": ("identified", "diagnosed"),
        "bands": WIDE,
    },
}
"""Named sets of settings; options that a user gives replace those of the set.

paper: the paper's claim, band by band; prompt, late: one sample of delay, and three with drives
that lag by 30 ms; saturated: references beyond the torque limit; contact: real rollers on a real
floor; payload: a load is put on in mid-run; tilt, coulomb: an effect is hidden, before and after
it is diagnosed.
"""


def settings(suite: str, given: Mapping[str, Any]) -> Settings:
    """Settings of a suite, changed where ``given`` holds more than None.

    Raises
    ------
    InputError
        If the suite is unknown, or the settings cannot be.
    """
    if suite not in SUITES:
        close = difflib.get_close_matches(suite, SUITES, 1)
        hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(SUITES)}"
        raise InputError(f"suite {suite!r}: not known; {hint}")
    names = {field.name for field in fields(Settings)}
    said = {name: value for name, value in given.items() if value is not None}
    assert names.issuperset(said)
    chosen = Settings(**{**SUITES[suite], **said})
    for controller in chosen.controllers:
        registry.check(controller)
    if "against" in said and chosen.against not in chosen.controllers:
        raise InputError(
            f"against: {chosen.against!r} is not compared; name one of "
            f"{', '.join(chosen.controllers)}"
        )
    return chosen


def settings_from_options(suite: str, options: Mapping[str, Any]) -> Settings:
    """Settings of a suite, changed by options of the command line: texts, numbers and lists.

    Parameters
    ----------
    options : by the name of the setting; None where an option was not given

    Raises
    ------
    InputError
        As :func:`settings`, and if a text cannot be read.
    """
    lists = {name: options[name] for name in ("plants", "effects", "surprises")}
    read = {
        **{name: tuple(values) if values else None for name, values in lists.items()},
        "models": words("model", options["models"]),
        "controllers": words("controllers", options["controllers"]),
        "bands": bands(options["bands"]),
        "amplitude": amplitude(options["amplitude"]),
    }
    return settings(suite, {**options, **read})


def words(what: str, text: str | None) -> tuple[str, ...] | None:
    """Names separated by commas, or InputError if there is none."""
    if text is None:
        return None
    found = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    if not found:
        raise InputError(f"{what}: none is named")
    return found


def bands(text: str | None) -> tuple[Band, ...] | None:
    """Bands [rad/s] such as "0.5-1,1-2"."""
    if text is None:
        return None
    found = []
    for word in words("bands", text) or ():
        low, _, high = word.partition("-")
        try:
            edges = float(low), float(high)
        except ValueError:
            edges = (math.nan, math.nan)
        if not 0 < edges[0] < edges[1] < math.inf:
            raise InputError(f"bands: {word!r} is no band in rad/s; write for instance 0.5-1,1-2")
        found.append(edges)
    return tuple(found)


def amplitude(text: str | None) -> tuple[float, float, float] | None:
    """Peaks of VX, VY [m/s] and W [rad/s] such as "0.22,0.18,0.6"."""
    if text is None:
        return None
    try:
        vx, vy, wz = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(
            f"amplitude: {text!r} is not three numbers; write for instance 0.22,0.18,0.6"
        ) from None
    return vx, vy, wz
