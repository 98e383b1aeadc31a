"""What names of topics, fields and columns mean: wheels, quantities, units.

A name is cut into words (at signs, digits and capitals), and each word is looked up; so the order
of the words, and what else stands among them, does not matter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

from youbot_env.physics.hardware import WHEELS

VELOCITY, EFFORT, POSITION, COMMAND = "velocity", "effort", "position", "command"

UNITS: dict[str, tuple[str, float]] = {
    "rad/s": (VELOCITY, 1.0),
    "rad/min": (VELOCITY, 1 / 60),
    "deg/s": (VELOCITY, pi / 180),
    "rpm": (VELOCITY, pi / 30),
    "turn/s": (VELOCITY, 2 * pi),
    "mrad/s": (VELOCITY, 1e-3),
    "count/s": (VELOCITY, 2 * pi),
    "m/s": (VELOCITY, 1.0),
    "mm/s": (VELOCITY, 1e-3),
    "cm/s": (VELOCITY, 1e-2),
    "N m": (EFFORT, 1.0),
    "mN m": (EFFORT, 1e-3),
    "uN m": (EFFORT, 1e-6),
    "N cm": (EFFORT, 1e-2),
    "N mm": (EFFORT, 1e-3),
    "kgf cm": (EFFORT, 0.0980665),
    "ozf in": (EFFORT, 0.00706155),
    "lbf in": (EFFORT, 0.112985),
    "A": (EFFORT, 1.0),
    "mA": (EFFORT, 1e-3),
    "rad": (POSITION, 1.0),
    "deg": (POSITION, pi / 180),
    "turn": (POSITION, 2 * pi),
    "mrad": (POSITION, 1e-3),
    "count": (POSITION, 2 * pi),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "min": ("time", 60.0),
    "day": ("time", 86400.0),
}
"""Units by their name here: of what they are, and what makes SI units of them.

Amperes need the torque constant besides, counts the counts of a turn, and speeds over ground the
radius of the wheel.
"""

CURRENTS = ("A", "mA")
COUNTS = ("count", "count/s")
OVER_GROUND = ("m/s", "mm/s", "cm/s")

_SPELLINGS = {
    "rad/s": "rad/s rads rad/sec rads/s radps radpersec rad*s-1 rads-1 1/s s-1 radian/s radians/s "
    "rad_s rad_per_s radpersecond rad_sec",
    "rad/min": "rad/min radpermin rad_min",
    "deg/s": "deg/s °/s dps degps deg/sec degs degrees/s grad/s deg_s degpersec deg_per_s "
    "degree/s deg_sec",
    "rpm": "rpm 1/min u/min r/min rev/min turns/min min-1 rev_min upm revpermin",
    "turn/s": "turns/s rps rev/s turn/s hz r/s revs/s u/s turns_s rev_s revps tps",
    "mrad/s": "mrad/s",
    "count/s": "counts/s ticks/s count/s tick/s cps qcps pps inc/s counts_s ticks_s",
    "m/s": "m/s mps m/sec m_s",
    "mm/s": "mm/s mmps mm_s",
    "cm/s": "cm/s cm_s",
    "N m": "nm n*m n.m n·m n-m newtonmeter newtonmetre newton_metre newton-meter n_m n⋅m",
    "mN m": "mnm mn*m mn.m mn·m mn_m mn⋅m",
    "uN m": "unm µnm μnm",
    "N cm": "ncm n*cm n·cm n_cm",
    "N mm": "nmm n*mm n·mm n_mm",
    "kgf cm": "kgcm kgfcm kgf*cm kg*cm kgf·cm kg·cm",
    "ozf in": "ozin oz-in oz*in ozfin",
    "lbf in": "lbin lb-in lb*in lbfin",
    "A": "a amp amps ampere amperes",
    "mA": "ma milliamp milliamps milliampere milliamperes",
    "rad": "rad radian radians",
    "deg": "deg degree degrees ° grad",
    "turn": "turns turn rev revs revolutions",
    "mrad": "mrad",
    "count": "counts ticks count tick inc increments cnt cts encodercounts qc",
    "m": "m meter meters metre metres",
    "cm": "cm",
    "mm": "mm",
    "s": "s sec secs second seconds sek",
    "ms": "ms msec msecs millis milliseconds millisecond",
    "us": "us µs μs usec usecs micros microseconds microsecond",
    "ns": "ns nsec nsecs nanos nanoseconds nanosecond nanosec",
}
_UNIT_OF = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}

_QUANTITIES = {
    VELOCITY: "velocity velocities vel vels speed speeds omega dq qd qdot dphi phidot thetadot "
    "rpm spd angvel angularvelocity wheelspeed geschwindigkeit drehzahl vitesse velocita velocidad "
    "rate dtheta phip tachometer tacho",
    EFFORT: "effort efforts torque torques tau trq tq moment drehmoment couple coppia eff nm mnm "
    "tork",
    "current": "current currents curr amp amps ampere amperes amperage strom courant corrente "
    "corriente",
    POSITION: "position positions pos angle angles enc encoder encoders ticks counts phi q theta "
    "winkel joint_angle rotation count tick",
    "voltage": "voltage volt volts pwm duty spannung",
    "time": "time timestamp timestamps stamp stamps t secs nsecs sec nanosec nsec seconds zeit "
    "datum datetime date clock temps ts epoch elapsed unixtime nanoseconds nanosecs millis micros "
    "tstamp usec msec",
    "yaw": "yaw heading psi theta phi orientation azimuth kurs bearing",
    "acceleration": "acceleration acc accel accelerations ddq qdd",
    "temperature": "temperature temp temperatur",
}
_MEANS = {word: quantity for quantity, words in _QUANTITIES.items() for word in words.split()}

_WANTED = frozenset(
    [
        "cmd",
        "command",
        "commanded",
        "commands",
        "desired",
        "des",
        "setpoint",
        "set",
        "ref",
        "reference",
        "target",
        "goal",
        "soll",
        "wanted",
        "demand",
        "demanded",
        "error",
        "err",
        "feedforward",
        "ff",
        "output",
    ]
)
_ROUGH = frozenset(
    ["raw", "unfiltered", "std", "cov", "covariance", "variance", "var", "min", "max"]
)

_FRONT, _BACK = (
    ("front", "vorne", "vorn", "avant", "f", "v"),
    (*("back", "rear", "hind", "hinten", "behind", "arriere", "b", "r", "h"),),
)
_LEFT, _RIGHT = ("left", "links", "gauche", "l"), ("right", "rechts", "droite", "droit", "r")

_CORNERS = {
    "fl": "fl lf vl frontleft leftfront flw lfw",
    "fr": "fr rf vr frontright rightfront frw rfw",
    "bl": "bl lb rl lr hl backleft leftback rearleft leftrear blw rlw lbw lrw",
    "br": "br rb rr hr backright rightback rearright rightrear brw rrw rbw",
}
_CORNER_OF = {word: corner for corner, words in _CORNERS.items() for word in words.split()}


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes
    ----------
    quantity : "velocity", "effort", "current", "position", "time", "yaw", ...; "" if it says none
    wheel : one of WHEELS, or ""
    number : index of a wheel or of a list, where the name holds one; None if not
    wanted : whether it is a set point, not a measurement
    unit : as the name states it, "" if it does not
    rest : the other words, alike for the columns of one group
    """

    quantity: str = ""
    wheel: str = ""
    number: int | None = None
    wanted: bool = False
    unit: str = ""
    rest: tuple[str, ...] = ()


@lru_cache(maxsize=1 << 14)
def unit_in_name(name: str) -> tuple[str, str]:
    """A name without the unit that it states, and that unit as `UNITS` has it ("" if none).

    Brackets of any kind may hold it (``time [s]``), or it ends the name (``speed_fl_rpm``).
    """
    bracketed = re.search(r"[\[(<{]\s*([^\[\](){}<>]*?)\s*[\])>}]\s*$", name)
    if bracketed:
        unit = _UNIT_OF.get(_spelled(bracketed[1]))
        return (name[: bracketed.start()].strip(), unit) if unit else (name, "")
    slash = re.search(r"\s*/\s*([^/\s]+(?:/(?:s|min|sec))?)\s*$", name)
    # "omega / rad/s", as physicists label an axis; a path such as /a/b has no blank.
    if slash and " /" in name and (unit := _UNIT_OF.get(_spelled(slash[1]))):
        return name[: slash.start()].strip(), unit
    words = re.split(r"[_\s.]+", name)
    for count in (3, 2, 1):
        if len(words) <= count:
            continue
        unit = _UNIT_OF.get(_spelled("_".join(words[-count:])))
        unit = unit or (_UNIT_OF.get(_spelled("".join(words[-count:]))) if count > 1 else None)
        if unit and not _is_a_word(words[-count:], unit):
            return "_".join(words[:-count]), unit
    return name, ""


def _spelled(text: str) -> str:
    return re.sub(r"\s+", "", text).lower().replace("⁻¹", "-1").replace("^", "")


def _is_a_word(words: list[str], unit: str) -> bool:
    """Whether the last words of a name are more likely a name than a unit: a lone "a" or "m"."""
    alone = len(words) == 1 and len(words[0]) == 1
    # "motor_A", "pos_m": a lone letter is a unit only where it is written as one is.
    return alone and not (words[0] == unit and unit in ("A", "s", "m"))


@lru_cache(maxsize=1 << 14)
def words_of(name: str) -> tuple[str, ...]:
    """The words of a name, in lower case: wheelSpeed_FL[0] has wheel, speed, fl, 0."""
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    # Letters of one case or digits: "wheel1" are two words, "FL" is one.
    return tuple(word.lower() for word in re.findall(r"[A-Za-zäöüßéèµ°]+|\d+", name))


@lru_cache(maxsize=1 << 14)
def meaning(name: str) -> Meaning:
    """What a name says, word by word."""
    bare, unit = unit_in_name(name)
    found = Meaning(unit=unit)
    rest: list[str] = []
    words = _joined(words_of(bare))
    for word in words:
        if word in _CORNER_OF and not found.wheel:
            found = replace(found, wheel=_CORNER_OF[word])
        elif word in _WANTED:
            found = replace(found, wanted=True)
        elif word.isdigit():
            found = replace(found, number=int(word))
        elif word in _MEANS and _goes_before(_MEANS[word], found.quantity):
            found = replace(found, quantity=_MEANS[word])
        else:
            rest.append(word)
    if not found.quantity and unit in UNITS and UNITS[unit][0] in (VELOCITY, EFFORT, POSITION):
        found = replace(found, quantity="current" if unit in CURRENTS else UNITS[unit][0])
    if found.quantity == EFFORT and unit in CURRENTS:
        found = replace(found, quantity="current")
    return replace(found, rest=tuple(rest))


def _goes_before(new: str, old: str) -> bool:
    """Whether a word's quantity replaces that of the words before: "motor position speed"."""
    # "encoder velocity" is a velocity, "joint angle rate" too; "current position" is a position.
    order = ("", "time", "yaw", "temperature", "current", POSITION, EFFORT, VELOCITY)
    rank = {quantity: k for k, quantity in enumerate(order)}
    return rank.get(new, len(order)) >= rank.get(old, len(order)) if old else True


def _joined(words: tuple[str, ...]) -> list[str]:
    """Words in which "front", "left" have become "fl", whatever stands between them."""
    found = list(words)
    ends = [k for k, word in enumerate(found) if word in _FRONT[:-2] or word in _BACK[:-3]]
    sides = [k for k, word in enumerate(found) if word in _LEFT[:-1] or word in _RIGHT[:-1]]
    if len(ends) == 1 and len(sides) == 1:
        end = "f" if found[ends[0]] in _FRONT else "b"
        side = "l" if found[sides[0]] in _LEFT else "r"
        first, second = sorted((ends[0], sides[0]))
        return [*found[:first], end + side, *found[first + 1 : second], *found[second + 1 :]]
    for k in range(len(found) - 1):
        # "f_l", "v.l": two lone letters in a row.
        pair = found[k] + found[k + 1]
        if len(pair) == 2 and pair in _CORNER_OF and len(found[k]) == 1:
            return [*found[:k], pair, *found[k + 2 :]]
    return found


def is_rough(name: str) -> bool:
    """Whether a name speaks of a statistic or a raw value, beside which another one is better."""
    return bool(_ROUGH & set(words_of(name)))


def is_known_wheel_order(wheels: list[str]) -> bool:
    """Whether four names are the four wheels, in any order."""
    return sorted(wheels) == sorted(WHEELS)
