"""Findings as sentences, each with an action at the robot that can confirm it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from identification.diagnosis.kinematic_sentences import KINEMATIC_WORDS
from youbot_env.physics.catalogue import GRAVITY
from youbot_env.physics.effect import effect_of, with_unit
from youbot_env.physics.hardware import WHEEL_WORDS

Values = Mapping[str, float]


def describe(effect: Any, values: Values, base: Values) -> str:
    """One sentence on an effect at its fitted size.

    Parameters
    ----------
    effect : from a catalogue
    values : the effect's public parameters; ``base``: those of the base model, and of the model's
        effects as EFFECT.PARAMETER

    Effects without words of their own, a user's for instance, get their numbers and the sentence
    on how to recognise them that they were registered with.
    """
    words = WORDS.get(effect_of(effect.name))
    if words is not None:
        return words(values, base)
    units = {name: effect.public_parameter(name).unit for name in values}
    numbers = ", ".join(
        f"{name} = {with_unit(f'{value:.3g}', units[name])}" for name, value in values.items()
    )
    return f"{effect_of(effect.name).replace('_', ' ')} ({numbers}): {effect.recognise}"


def _heading(x: float, y: float) -> str:
    """Direction of a vector in the world, in words; "of the start heading" goes with it."""
    angle = math.degrees(math.atan2(y, x))
    side = "left" if angle > 0 else "right"
    return "straight ahead" if abs(angle) < 1 else f"{abs(angle):.0f} degrees {side}"


def _tilt(values: Values, base: Values) -> str:
    x, y = values["tilt_x"], values["tilt_y"]
    slope = math.hypot(math.tan(x), math.tan(y))
    where = _heading(-math.tan(x), -math.tan(y))
    force = base["m0"] * GRAVITY * math.hypot(math.sin(x), math.sin(y))
    return (
        f"the floor falls by {math.degrees(math.atan(slope)):.2f} degrees towards {where} of the "
        f"start heading; it costs {force:.1f} N; to confirm, turn the robot around: the residual's "
        "sign must flip"
    )


def _coulomb(values: Values, base: Values) -> str:
    speed = values["torque"] / max(base["mu1"], 1e-9)
    return (
        f"each wheel joint has {values['torque']:.3f} N m of dry friction, as much as the viscous "
        f"friction at {speed:.1f} rad/s; to confirm, push the robot by hand: it must resist before "
        "it moves"
    )


def _stribeck(values: Values, base: Values) -> str:
    return (
        f"each wheel joint has {values['torque']:.3f} N m of dry friction and "
        f"{values['breakaway']:.3f} N m more below some {values['stribeck_speed']:.2g} rad/s; to "
        "confirm, creep: the torque must fall as the wheels begin to turn"
    )


def _uneven(values: Values, base: Values) -> str:
    wheel, extra = max(values.items(), key=lambda item: item[1])
    name = WHEEL_WORDS[wheel.rsplit("_", 1)[1]]
    share = extra / max(base["mu1"], 1e-9)
    return (
        f"the {name} wheel drags: {extra:.3f} N m s of viscous friction beyond the freest wheel's, "
        f"{share:.0%} more; to confirm, lift the robot and spin the wheels by hand"
    )


def _gain(values: Values, base: Values) -> str:
    wheel, gain = max(values.items(), key=lambda item: abs(item[1]))
    name = WHEEL_WORDS[wheel.rsplit("_", 1)[1]]
    kind = "more" if gain > 0 else "less"
    return (
        f"the {name} wheel's true torque is {abs(gain):.1%} {kind} than its channel says, relative "
        "to the four wheels' mean; to confirm, swap two motors or check the torque constants"
    )


def _lag(values: Values, base: Values) -> str:
    return (
        f"the drives follow their commands with a lag of {1e3 * values['time_constant']:.0f} ms, "
        "or the speeds are filtered by as much; to confirm, command a step of torque with the "
        "wheels held"
    )


def _delay(values: Values, base: Values) -> str:
    delay = 1e3 * values["delay"]
    later = "speeds lag their torques" if delay > 0 else "torques lag their speeds"
    return (
        f"the log's {later} by {abs(delay):.1f} ms; to confirm, compare the time stamps of both "
        "channels in the driver"
    )


def _ripple(values: Values, base: Values) -> str:
    return (
        f"a torque of {values['amplitude']:.3f} N m comes {values['cycles']:.0f} times a wheel "
        "turn; to confirm, turn a lifted wheel slowly and count what the hand feels"
    )


def _tether(values: Values, base: Values) -> str:
    x, y, stiffness = values["anchor_x"], values["anchor_y"], values["stiffness"]
    distance = math.hypot(x, y)
    if distance > 100.0:
        # No cable is as long: within a room such a pull is the same everywhere.
        return (
            f"a force of {stiffness * distance:.1f} N pulls the robot towards "
            f"{_heading(x, y)} of the start heading, wherever it stands and however it is turned, "
            "as a slope does; to confirm, start turned around: it must then pull the other way"
        )
    return (
        f"something pulls the robot towards ({x:.2f}, {y:.2f}) m with {stiffness:.2g} N/m: "
        "a cable, perhaps; to confirm, unplug it"
    )


def _payload(values: Values, base: Values) -> str:
    load = f"{values['mass']:.2f} kg"
    place = f"({values['x']:.2f}, {values['y']:.2f}) m"
    if values["time"] < 0.5:
        return f"{load} are on at {place} from the start"
    return f"{load} were put on at {place}, {values['time']:.0f} s after the log's start"


def _one_wheel(values: Values, prefix: str) -> tuple[str, float]:
    """The wheel with the largest of the values ``prefix_*``, in words, and that value."""
    of = {key: value for key, value in values.items() if key.startswith(f"{prefix}_")}
    name, value = max(of.items(), key=lambda item: abs(item[1]))
    return WHEEL_WORDS[name.rsplit("_", 1)[1]], value


def _offset(values: Values, base: Values) -> str:
    name, offset = _one_wheel(values, "offset")
    return (
        f"the torque channels have a zero error: the {name} wheel's true torque is {offset:+.3f} "
        "N m beside what its channel says; to confirm, read the channels while nothing is driven"
    )


def _uneven_dry(values: Values, base: Values) -> str:
    name, extra = _one_wheel(values, "extra")
    return (
        f"the {name} wheel drags: {extra:.3f} N m of dry friction in its joint; to confirm, lift "
        "the robot and turn the wheels slowly by hand"
    )


def _uneven_rollers(values: Values, base: Values) -> str:
    extra = {
        end: values[f"extra_{end[0]}l"] + values[f"extra_{end[0]}r"] for end in ("front", "back")
    }
    end = max(extra, key=lambda one: extra[one])
    return (
        f"the rollers of the {end} wheels drag: {extra[end]:.3f} N m of dry friction, both "
        "together; they turn at one speed, so that no log tells which of the two; to confirm, lift "
        "the robot and turn the rollers by hand"
    )


def _drift(values: Values, base: Values) -> str:
    clock = "the session" if values["shared_clock"] > 0.5 else "each log"
    return (
        f"the torque constant falls by {values['fraction']:.1%} from the start of {clock}, with a "
        f"time constant of {values['time_constant']:.0f} s; to confirm, log with cold and with "
        "warm motors"
    )


def _speed_gain(values: Values, base: Values) -> str:
    return (
        f"the drives lose {values['loss']:.1%} of their torque at 10 rad/s of a wheel; to confirm, "
        "drive at another supply voltage"
    )


def _asymmetric(values: Values, base: Values) -> str:
    viscous = f"{values['viscous']:.4f} N m s more viscous friction"
    confirm = "to confirm, turn a lifted wheel both ways; a constant offset would stay at rest"
    dry = base.get("wheel_coulomb_friction.torque")
    if dry is None:
        return (
            f"each wheel has {values['coulomb']:.3f} N m more dry friction and {viscous} forwards, "
            f"and as much less backwards; {confirm}"
        )
    # Friction of one size and this are one law: what a wheel has each way.
    forwards, backwards = dry + values["coulomb"], dry - values["coulomb"]
    return (
        f"that dry friction depends on the direction: {forwards:.3f} N m forwards and "
        f"{backwards:.3f} N m backwards ({values['coulomb'] / dry:+.0%} and as much less), with "
        f"{viscous} forwards; {confirm}"
    )


def _scrub(values: Values, base: Values) -> str:
    return (
        f"{values['torque']:.2f} N m of dry moment resist turning: contact patches that scrub; to "
        "confirm, turn the robot on a smoother floor"
    )


def _cable(values: Values, base: Values) -> str:
    return (
        f"{values['force']:.2f} N of dry friction act against any motion of the robot's centre: a "
        "cable that is dragged along, perhaps; to confirm, unplug it"
    )


def _cable_twist(values: Values, base: Values) -> str:
    return (
        f"something turns the robot back with {values['stiffness']:.2g} N m/rad towards a heading "
        f"of {math.degrees(values['neutral']):.0f} degrees: a cable that winds up, perhaps; to "
        "confirm, unplug it"
    )


def _saturation(values: Values, base: Values) -> str:
    return (
        f"no wheel gets more than {values['limit']:.2f} N m, whatever its channel says; to "
        "confirm, look for a current limit in the drives"
    )


def _dead_zone(values: Values, base: Values) -> str:
    return (
        f"torques below {values['width']:.3f} N m do nothing, and larger ones act by as much less; "
        "to confirm, raise the torque of a lifted wheel slowly from zero"
    )


def _resonance(values: Values, base: Values) -> str:
    return (
        f"the drives follow their commands as a swing of {values['frequency']:.1f} rad/s with a "
        f"damping of {values['damping']:.2f}; to confirm, command a step of torque with the wheels "
        "held"
    )


def _warmup(values: Values, base: Values) -> str:
    # One axis has no such switch.
    clock = "the session" if values.get("shared_clock", 0.0) > 0.5 else "each log"
    return (
        f"friction is {values['fraction']:.0%} larger at the start of {clock} and falls with a "
        f"time constant of {values['time_constant']:.0f} s; to confirm, log with a warm robot"
    )


WORDS: dict[str, Callable[[Values, Values], str]] = {
    "floor_tilt": _tilt,
    "wheel_coulomb_friction": _coulomb,
    "wheel_stribeck_friction": _stribeck,
    "uneven_wheel_friction": _uneven,
    "torque_gain_error": _gain,
    "actuator_lag": _lag,
    "torque_delay": _delay,
    "torque_ripple": _ripple,
    "tether": _tether,
    "payload_change": _payload,
    **KINEMATIC_WORDS,
    "friction_warmup": _warmup,
    "torque_offset": _offset,
    "torque_saturation": _saturation,
    "dead_zone": _dead_zone,
    "drive_resonance": _resonance,
    "torque_constant_drift": _drift,
    "speed_dependent_gain": _speed_gain,
    "uneven_coulomb_friction": _uneven_dry,
    "uneven_roller_friction": _uneven_rollers,
    "asymmetric_friction": _asymmetric,
    "yaw_scrub": _scrub,
    "cable_drag": _cable,
    "cable_twist": _cable_twist,
}
