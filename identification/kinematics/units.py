"""The unit and the gear of wheel speeds, found by the radius that a pose gives them.

A log's number u is speed [rad/s] of a wheel times the unit's factor times the gear, so that the
radius of the wheel is what a pose gives per number times both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from identification.kinematics.settings import KinematicsSettings

UNITS = {
    "rad/s": 1.0,
    "rpm": 30 / math.pi,
    "degrees/s": 180 / math.pi,
    "turns/s": 1 / (2 * math.pi),
    "rad/min": 60.0,
    "turns/min times 1000": 30 / math.pi * 1e-3,
    "mrad/s": 1e3,
    "0.01 rpm": 100 * 30 / math.pi,
    "rad/h": 3600.0,
}
"""Units of an angular speed, by the number that 1 rad/s has in them."""

GEARS = (
    *(1.0, 5.0, 10.0, 20.0, 50.0, 100.0, 9405 / 364),
    *(2.0, 3.0, 4.0, 6.0, 7.0, 8.0, 9.0, 12.0, 14.0, 15.0, 16.0, 18.0, 19.0, 24.0, 25.0),
    *(26.0, 27.0, 30.0, 35.0, 36.0, 40.0, 45.0, 47.0, 60.0, 64.0, 70.0, 75.0, 80.0),
)
"""Motor turns per wheel turn of common gears, the roundest and the youBot's 25.84 first."""

ROUND_GEARS = GEARS[:6]
YOUBOT_GEAR = GEARS[6]


@dataclass(frozen=True)
class SpeedUnit:
    """A unit of the wheel speeds: the number that 1 rad/s of a wheel has, and the radius then.

    ``name`` in words, ``factor`` numbers per rad/s of the wheel, ``radius`` [m].
    """

    name: str
    unit: str
    gear: float
    radius: float

    @property
    def factor(self) -> float:
        """Numbers in the log per rad/s of the wheel."""
        return UNITS[self.unit] * self.gear if self.unit in UNITS else self.gear * self.radius


def speed_units(
    per_number: float,
    radius: float,
    known: bool,
    settings: KinematicsSettings = KinematicsSettings(),
) -> list[SpeedUnit]:
    """Units and gears that make a radius of what a pose gives per number of the log, best first.

    Parameters
    ----------
    per_number : way [m] of the platform per number of the log and second
    radius : of the wheels, as the geometry has it [m]
    known : whether that is the robot's own; else any usual radius counts
    """
    found = []
    for gear in GEARS:
        rare_gear = settings.odd_gear_cost * (gear not in ROUND_GEARS)
        rare_gear += settings.gear_cost * (gear != 1.0)
        usual = _USUAL if gear == 1.0 else _OF_MOTORS
        for unit, factor in UNITS.items():
            made = SpeedUnit(_name(unit, gear), unit, gear, per_number * factor * gear)
            cost = rare_gear + settings.rare_unit_cost * (unit not in usual)
            if gear == YOUBOT_GEAR and _misfit(made.radius, radius, True, settings) < 1.0:
                cost -= settings.odd_gear_cost  # no odd gear, if the wheels are a youBot's too
            found.append((cost + _misfit(made.radius, radius, known, settings), made))
        if abs(per_number * gear - 1) < settings.rim_tolerance:
            made = SpeedUnit(_name("m/s of the rim", gear), "m/s", gear, radius)
            found.append((rare_gear, made))
    limit = settings.max_unit_cost
    return [unit for cost, unit in sorted(found, key=lambda pair: pair[0]) if cost <= limit]


_USUAL = ("rad/s", "rpm", "degrees/s", "turns/s", "rad/min")
_OF_MOTORS = ("rad/s", "rpm", "rad/min")
"""Units that are usual: of a wheel, and of a motor behind a gear; others cost half an error."""


def _misfit(radius: float, nominal: float, known: bool, settings: KinematicsSettings) -> float:
    """How badly a radius fits: the geometry's own within its tolerance, or any usual one."""
    far = abs(math.log(radius / (nominal if known else settings.usual_radius)))
    return far / math.log(settings.radius_ratio if known else settings.usual_radius_ratio)


def _name(unit: str, gear: float) -> str:
    return unit if gear == 1.0 else f"{unit} of the motor at {gear:.4g}:1"
