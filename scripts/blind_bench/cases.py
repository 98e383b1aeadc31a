"""Blind cases: a random platform with planted effects, driven and logged like the given data."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from identification.logs.log import Log
from identification.logs.reading import write_log
from youbot_env.errors import InputError
from youbot_scripts.blind_bench import motions, second_simulator as plant, sensors, wheel_effects
from youbot_scripts.blind_bench.effects import (
    BEYOND,
    CATALOGUE,
    DIFFER,
    EVERYTHING,
    FOREIGN,
    KINEMATICS,
    OUTSIDE,
    REGIMES,
    Planted,
    draw,
    pairs,
    planted_physics,
)

Array = NDArray[np.float64]

WHEEL_MASS = 1.4
"""[kg] of each wheel. m0 includes the wheels; aX and aY are of the body without them."""

RANGES = {
    "m0": (32.0, 38.0),
    "I0": (3.2, 5.5),
    "I1": (0.004, 0.0085),
    "aX": (-0.028, 0.028),
    "aY": (-0.028, 0.028),
    "mu1": (0.07, 0.15),
    "mu2": (0.003, 0.007),
}
"""Of random platforms, SI units: those of the given data."""

KINDS = (
    "none",
    "noise",
    "counts",
    "one",
    "quarter",
    "double_noise",
    "two",
    "unknown",
    "differ",
    "regime",
    "sweep",
    "kinematics",
    "law",
    "foreign",
    "fleet",
)
"""Nothing planted; nothing, and noise that is not white; speeds from encoder counts, with Coulomb
friction in every other case; one effect of about its size; a quarter of it under twice the noise;
one of about its size under twice the noise; two of about their size; one outside the catalogue;
one of about its size in some logs only; one outside the catalogue in a part of the motion;
one at each of `SWEEP` times its size; one effect of kinematics of about its size; one of all
outside the catalogue that the grammar was built with; one of those it was not; one effect of about
its size in one of `FAULTY_ONE_IN` cases, of calibration and one multisine."""

SWEEP = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0)
ALL_RATES = (50.0, 100.0, 250.0)
RATES = {
    "none": ALL_RATES,
    "noise": ALL_RATES,
    "kinematics": (100.0, 50.0, 250.0),
    "fleet": (50.0,),
}
"""Log rates [Hz] that a kind goes through; 100 Hz for the others."""

PAUSE = 20.0
"""[s] Between two logs of a session."""

FAULTY_ONE_IN = 10
"""Cases of a fleet among which one has an effect."""

POSE_SHARE = 0.5
"""Share of the cases whose logs hold the pose."""


@dataclass(frozen=True)
class Case:
    """One blind case, determined by kind, index, seed and rate."""

    kind: str
    index: int
    seed: int
    rate: float
    noise: float
    has_pose: bool
    platform: dict[str, float]
    planted: tuple[Planted, ...]
    sensing: sensors.Sensing | None = None

    @property
    def key(self) -> str:
        """A name that no other case has."""
        return f"{self.kind}-{self.seed}-{self.index}-{self.rate:g}Hz-x{self.noise:.3g}"

    def to_dict(self) -> dict[str, Any]:
        """JSON form: all that was drawn."""
        return asdict(self) | {"key": self.key}


def _generator(seed: int, kind: str, index: int, purpose: str) -> np.random.Generator:
    # An own stream for each purpose: one more draw for one purpose leaves the others as they are.
    # crc32 and not hash(), which differs from one process to the next.
    return np.random.default_rng(
        [seed, zlib.crc32(kind.encode()), index, zlib.crc32(purpose.encode())]
    )


def references(kind: str, index: int, seed: int, dt: float) -> dict[str, Array]:
    """Twists (N, 3) asked for, by log; the multisines are the case's own."""
    multisines = ("multisine_a",) if kind == "fleet" else ("multisine_a", "multisine_b")
    return {
        "calibration": motions.calibration(dt),
        **{name: motions.multisine(_generator(seed, kind, index, name), dt) for name in multisines},
    }


def _path(twists: dict[str, Array], dt: float) -> Array:
    """Places (n, 2) [m] that the references pass."""
    places = []
    for twist in twists.values():
        yaw = np.cumsum(twist[:, 2]) * dt
        velocity = (twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * yaw)
        place = np.cumsum(velocity) * dt
        places.append(np.column_stack([place.real, place.imag])[::50])
    return np.concatenate(places)


def draw_case(
    kind: str,
    index: int,
    seed: int,
    rate: float | None = None,
    noise: float | None = None,
    factor: float | None = None,
) -> Case:
    """Case number ``index`` of a kind.

    Parameters
    ----------
    kind : one of KINDS; an effect's name plants that alone, a noise's has that and nothing planted
    index : from 0; consecutive indices go through effects and rates in turn
    rate : of the logs [Hz]; None: what the kind goes through
    noise : factor on the base noise; None: as the kind has it
    factor : on the sizes of what is planted; None: as the kind has it

    Raises
    ------
    InputError
        If the kind is unknown or the rate is out of its range.
    """
    rng = _generator(seed, kind, index, "case")
    rates = RATES.get(kind, (100.0,))
    rate = float(rates[index % len(rates)] if rate is None else rate)
    if not 20.0 <= rate <= 1000.0:
        raise InputError(f"rate: {rate:g} Hz is outside 20 to 1000 Hz")
    platform = {name: float(rng.uniform(*edges)) for name, edges in RANGES.items()}
    has_pose = bool(rng.random() < POSE_SHARE)
    # Drawn for every kind, and also if `noise` is given: later draws then stay the same.
    any_noise = 2.0 ** rng.uniform(-1, 1)
    drawn_noise = {
        "none": any_noise,
        "noise": any_noise,
        "fleet": any_noise,
        "quarter": 2.0,
        "double_noise": 2.0,
    }
    # On a fixed grid, so that a case plants the same at every log rate.
    path = _path(references(kind, index, seed, 0.02), 0.02)
    planted = tuple(
        draw(name, usual if factor is None else factor, rng, path)
        for name, usual in _what(kind, index, seed, rng)
    )
    if kind == "differ":
        planted = tuple(_in_some_logs(item, index) for item in planted)
    noise = drawn_noise.get(kind, 1.0) if noise is None else float(noise)
    measured = _sensing(kind, index, seed, rate)
    return Case(kind, index, seed, rate, noise, has_pose, platform, planted, measured)


def _sensing(kind: str, index: int, seed: int, rate: float) -> sensors.Sensing | None:
    """How a case is measured, if not with white noise."""
    rng = _generator(seed, kind, index, "sensing")
    if kind == "counts":
        counts = sensors.COUNTS[index % len(sensors.COUNTS)]
        return sensors.Sensing(sensors.ENCODER, {"counts": counts})
    if kind == "noise":
        names = list(sensors.NOISES)
        return sensors.draw(names[index % len(names)], rng, rate)
    return sensors.draw(kind, rng, rate) if kind in sensors.ALL else None


def _what(kind: str, index: int, seed: int, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Names and factors of what a case plants."""
    names = list(CATALOGUE)
    about_one = 2.0 ** rng.uniform(-0.5, 0.5, 2)
    if kind in ("none", "noise") or kind in sensors.ALL:
        return []
    if kind == "counts":
        # Every other case, so that six in a row meet all counts with and without it.
        return [("wheel_coulomb_friction", about_one[0])] if index % 2 == 0 else []
    if kind == "fleet":
        number, place = divmod(index, FAULTY_ONE_IN)
        faulty = place == FAULTY_ONE_IN - 1
        return [(names[number % len(names)], about_one[0])] if faulty else []
    if kind in ("one", "double_noise"):
        return [(names[index % len(names)], about_one[0])]
    if kind == "quarter":
        return [(names[index % len(names)], about_one[0] / 4)]
    if kind == "two":
        order = np.random.default_rng(seed).permutation(len(pairs()))
        pair = pairs()[order[index % len(order)]]
        return list(zip(pair, about_one.tolist(), strict=True))
    if kind == "differ":
        name = list(DIFFER)[index % len(DIFFER)]
        return [(name, DIFFER[name][0] * about_one[0])]
    if kind == "regime":
        return [(list(REGIMES)[index % len(REGIMES)], about_one[0])]
    if kind == "unknown":
        return [(list(OUTSIDE)[index % len(OUTSIDE)], about_one[0])]
    if kind in ("law", "foreign"):
        known = list(BEYOND if kind == "law" else FOREIGN)
        return [(known[index % len(known)], about_one[0])]
    if kind == "sweep":
        return [(names[index % len(names)], SWEEP[index // len(names) % len(SWEEP)])]
    if kind == "kinematics":
        return [(list(KINEMATICS)[index % len(KINEMATICS)], about_one[0])]
    if kind in EVERYTHING:
        return [(kind, about_one[0])]
    raise InputError(
        f"kind {kind!r}: not known; use {', '.join(KINDS)}, or the name of an effect or "
        f"a noise ({', '.join(sensors.ALL)})"
    )


def _in_some_logs(item: Planted, index: int) -> Planted:
    """What is planted, in one log or in the last two, in turn."""
    chosen = DIFFERING[index // len(DIFFER) % len(DIFFERING)]
    return replace(item, values={**item.values, **DIFFER[item.name][1]}, logs=chosen)


DIFFERING = (("multisine_b",), ("multisine_a", "multisine_b"), ("multisine_a",))
"""Logs in which effects are planted that do not act in all."""


def physics(case: Case, log: str = "") -> plant.Physics:
    """The platform of a case with all that is planted in a log."""
    values = dict(case.platform)
    # The wheels lie symmetric about O and have no first moment.
    mass = values["m0"] - 4 * WHEEL_MASS
    moments = {"moment_x": mass * values.pop("aX"), "moment_y": mass * values.pop("aY")}
    base = plant.Physics(
        drag=np.zeros(4),
        gain=np.zeros(4),
        offset=np.zeros(4),
        dry=np.zeros(4),
        roller_dry=np.zeros(4),
        ripple_phase=np.zeros(4),
    )._replace(**values, **moments)
    return planted_physics(base, case.planted, log)


def simulate(
    case: Case, twist: Array, dt: float, began: float = 0.0, log: str = ""
) -> tuple[Array, Array, Array]:
    """True speeds (N, 4), commands (N, 4) and poses (N, 3) of a case's platform along a twist.

    ``began``: of the run [s], on the clock that a session's runs share; ``log``: its name
    """
    platform = physics(case, log)._replace(began=began)
    return plant.drive(platform, motions.wheel_speeds(twist), dt)


def tick(rate: float) -> tuple[float, int]:
    """Time [s] that a command is held, near 2 ms, and ticks in a row of a log of ``rate`` [Hz]."""
    ticks = max(1, round(1.0 / (rate * plant.TICK)))
    return 1.0 / (rate * ticks), ticks


def log_along(case: Case, name: str, twist: Array, began: float = 0.0) -> Log:
    """Log of a case's platform along a twist (N, 3) given at each tick of its rate.

    ``began``: when the run began [s], on the clock that the logs share; 0 where they share none.

    A row holds the speeds at its instant and the mean of the two commands that meet there, as the
    case measures them (with white noise, if nothing else is drawn), and is rounded to 4 decimals
    like the given data.
    """
    dt, ticks = tick(case.rate)
    speed, command, pose = simulate(case, twist, dt, began, name)
    time = dt * np.arange(len(speed))
    # Not row 0 nor the last: there only one command meets.
    rows = np.arange(ticks, len(speed) - 1, ticks)
    # The commands before and after an instant; meeting[k] belongs to time[k + 1].
    meeting = 0.5 * (command[:-1] + command[1:])
    delay = sum(item.values.get("delay", 0.0) for item in case.planted)
    effort = np.column_stack(
        [np.interp(time[rows] + delay, time[1:], meeting[:, k]) for k in range(4)]
    )
    rng = _generator(case.seed, case.kind, case.index, f"noise {name} {case.rate:g}")
    angle = cumulative_trapezoid(speed, dx=dt, axis=0, initial=0)[rows]
    shown = speed
    for item in case.planted:
        shown = wheel_effects.logged_speeds(item.name, item.values, shown, command, dt)
    true = sensors.Rows(np.asarray(time[rows], float), shown[rows], effort, angle)
    stamps, velocity, effort = sensors.sense(true, case.sensing, case.noise, rng)
    return Log(
        name=name,
        joints=("fl", "fr", "bl", "br"),
        time=began + stamps,
        velocity=np.round(velocity, 4),
        effort=np.round(effort, 4),
        pose=np.round(pose[rows], 4) if case.has_pose else None,
    )


def logs_of(case: Case) -> list[Log]:
    """Calibration and two multisines of a case, 260 s; of a fleet's one multisine, 200 s."""
    dt, _ = tick(case.rate)
    twists = references(case.kind, case.index, case.seed, dt)
    shares = any(CATALOGUE[p.name].on_shared_clock for p in case.planted if p.name in CATALOGUE)
    ends = np.cumsum([len(twist) * dt + PAUSE for twist in twists.values()])
    starts = [0.0, *ends[:-1].tolist()] if shares else [0.0] * len(twists)
    return [
        log_along(case, name, twist, began)
        for (name, twist), began in zip(twists.items(), starts, strict=True)
    ]


def unseen_log(case: Case) -> Log:
    """A multisine of a case's platform that no diagnosis has seen."""
    dt, _ = tick(case.rate)
    rng = _generator(case.seed, case.kind, case.index, UNSEEN)
    return log_along(case, UNSEEN, motions.multisine(rng, dt))


UNSEEN = "unseen"


def true_velocity_error(case: Case, speed: Array, effort: Array, dt: float, pose: Array) -> float:
    """Velocity error of the true platform's free run, driven by a log's torques alone: what the
    true law reaches.

    Parameters
    ----------
    speed, effort : (N, 4) wheel speeds [rad/s] and torques [N m] as logged, dt [s] apart
    pose : (3,) where it starts
    """
    measured = motions.twist_of(speed)
    predicted = motions.twist_of(plant.replay(physics(case), effort, dt, measured[0], pose))
    scale = np.array([motions.LEVER, motions.LEVER, 1.0])
    error = (measured - predicted) / scale
    return float(np.sqrt((error**2).sum() / ((measured / scale) ** 2).sum()))


SHORT_NAMES = {
    "wheel_coulomb_friction.torque": "wheel_coulomb",
    "floor_tilt.tilt_x": "tilt_x",
    "floor_tilt.tilt_y": "tilt_y",
    "uneven_wheel_friction.extra_fl": "drag_wheel_1",
    "uneven_wheel_friction.extra_fr": "drag_wheel_2",
    "uneven_wheel_friction.extra_bl": "drag_wheel_3",
    "uneven_wheel_friction.extra_br": "drag_wheel_4",
    "actuator_lag.time_constant": "lag",
    "torque_ripple.amplitude": "ripple",
    "torque_ripple.cycles": "ripple_n",
    "carpet_nap.force": "nap",
    "carpet_nap.direction": "nap_dir",
}
"""Names in truth.json that the given data use; others are called ``effect.parameter``."""


def truth(case: Case) -> dict[str, Any]:
    """The answer to a case, in the form of the given data's truth.json."""
    platform = {{"aX": "ax", "aY": "ay"}.get(key, key): v for key, v in case.platform.items()}
    effects = {
        SHORT_NAMES.get(f"{item.name}.{key}", f"{item.name}.{key}"): value
        for item in case.planted
        for key, value in item.values.items()
        if item.name != "torque_delay"
    }
    return {
        **platform,
        "effects": effects,
        "delay": sum(item.values.get("delay", 0.0) for item in case.planted),
        "radius": physics(case).radius.tolist(),
        "torque_noise": case.noise * plant.TORQUE_NOISE,
        "speed_noise": case.noise * plant.SPEED_NOISE,
        "torque_limit": plant.TORQUE_LIMIT,
        "per_log": {item.name: list(item.logs) for item in case.planted if item.logs},
        "planted": "+".join(item.name for item in case.planted) or "none",
        "rate": case.rate,
        "sensing": None if case.sensing is None else asdict(case.sensing),
    }


def write_case(folder: Path, case: Case) -> list[Path]:
    """Write a case's logs and its truth.json into a folder, which is made if missing.

    Returns the files of the logs, in the order of the logs.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    paths = []
    for log in logs_of(case):
        # Whether 4 decimals hold the time of every row exactly.
        exact = np.abs(log.time - np.round(log.time, 4)).max() < 1e-9
        paths.append(folder / f"{log.name}.csv")
        write_log(paths[-1], log, decimals=4 if exact else 9)
    (folder / "truth.json").write_text(json.dumps(truth(case), indent=1) + "\n", "utf-8")
    return paths
