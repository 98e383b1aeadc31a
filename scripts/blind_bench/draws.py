"""Random parameters of planted effects: functions (rng, size, path) -> values.

``size`` is the value of the main parameter; ``path`` (n, 2) are places [m] on the references.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = dict[str, float]

WHEELS = ("fl", "fr", "bl", "br")


def direction(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def vector(rng: np.random.Generator, size: float, *names: str) -> Values:
    angle = direction(rng)
    return dict(zip(names, (size * np.cos(angle), size * np.sin(angle)), strict=True))


def one_number(name: str) -> Callable[[np.random.Generator, float, Array], Values]:
    return lambda rng, size, path: {name: size}


def stribeck(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {
        "torque": size,
        "breakaway": size * rng.uniform(0.7, 1.5),
        "stribeck_speed": rng.uniform(0.35, 0.8),
    }


def uneven(rng: np.random.Generator, size: float, path: Array) -> Values:
    """One wheel has extra friction; in a third of the cases others have some, the freest none."""
    share = np.zeros(4)
    if rng.random() < 1 / 3:
        share = rng.uniform(0.0, 0.8, 4)
        share -= share.min()
    share[rng.integers(4)] = 1.0
    share -= share.min()
    return {f"extra_{wheel}": size * value for wheel, value in zip(WHEELS, share, strict=True)}


def gains(rng: np.random.Generator, size: float, path: Array) -> Values:
    """Gains of mean zero whose largest is ``size``: one wheel's error, or all four at random."""
    draw = rng.standard_normal(4) if rng.random() < 0.5 else np.eye(4)[rng.integers(4)]
    draw = draw * rng.choice([-1.0, 1.0])
    # A common gain of all wheels could not be told from other masses and frictions.
    draw -= draw.mean()
    draw *= size / np.abs(draw).max()
    return {f"gain_{wheel}": value for wheel, value in zip(WHEELS, draw, strict=True)}


def tether(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"stiffness": size, **vector(rng, rng.uniform(0.2, 1.5), "anchor_x", "anchor_y")}


def payload(rng: np.random.Generator, size: float, path: Array) -> Values:
    place = {"x": rng.uniform(-0.2, 0.2), "y": rng.uniform(-0.12, 0.12)}
    return {"mass": size, **place, "time": rng.uniform(15.0, 45.0)}


def ripple(rng: np.random.Generator, size: float, path: Array) -> Values:
    """One phase for all wheels or, in every other case, each its own."""
    phase = direction(rng) if rng.random() < 0.5 else 0.0
    cycles = float(rng.integers(4, 13))
    phases = dict.fromkeys(WHEELS, phase)
    if phase:
        phases = {wheel: direction(rng) for wheel in WHEELS}
    return {
        "amplitude": size,
        **{f"phase_{wheel}": value for wheel, value in phases.items()},
        "cycles": cycles,
    }


def offsets(rng: np.random.Generator, size: float, path: Array) -> Values:
    """Offsets of all four channels, the largest ``size``; none along what exerts no force."""
    draw = rng.uniform(-1.0, 1.0, 4)
    unseen = np.array([0.5, 0.5, -0.5, -0.5])
    draw -= unseen * (unseen @ draw)
    draw *= size / np.abs(draw).max()
    return {f"offset_{wheel}": value for wheel, value in zip(WHEELS, draw, strict=True)}


def one_wheel(rng: np.random.Generator, size: float, path: Array) -> Values:
    """One wheel has it, the others none."""
    share = np.eye(4)[rng.integers(4)]
    return {f"extra_{wheel}": size * value for wheel, value in zip(WHEELS, share, strict=True)}


def drift(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"fraction": size, "time_constant": rng.uniform(40.0, 120.0)}


def asymmetric(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"coulomb": size, "viscous": size * rng.uniform(0.05, 0.2)}


def swing(rng: np.random.Generator, size: float, path: Array) -> Values:
    """``size``: period over 2 pi [s]; the larger, the slower the drive."""
    return {"frequency": 1.0 / size, "damping": rng.uniform(0.2, 0.6)}


def limit(rng: np.random.Generator, size: float, path: Array) -> Values:
    """``size``: the inverse of the limit [1/(N m)], so that more is stronger."""
    return {"limit": 1.0 / size}


def twist(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"stiffness": size, "neutral": rng.uniform(-1.0, 1.0)}


def spot(rng: np.random.Generator, path: Array) -> Array:
    # Near the path: elsewhere the platform would never meet it.
    return path[rng.integers(len(path))] + rng.uniform(-0.05, 0.05, 2)


def line(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"stiffness": size, "direction": direction(rng), "offset": rng.uniform(-0.5, 0.5)}


def patch(rng: np.random.Generator, size: float, path: Array) -> Values:
    x, y = spot(rng, path)
    return {"force": size, "x": x, "y": y, "radius": rng.uniform(0.2, 0.35)}


def bump(rng: np.random.Generator, size: float, path: Array) -> Values:
    x, y = spot(rng, path)
    return {"force": size, "x": x, "y": y, "width": rng.uniform(0.1, 0.2)}


def directed(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "direction": direction(rng)}


def one_way(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"torque": size, "wheel": float(rng.integers(4)), "sign": float(rng.choice([-1, 1]))}


def late(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "time": rng.uniform(20.0, 40.0)}


def joints(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "distance": rng.uniform(0.1, 0.3), "phase": direction(rng)}


def cogging(rng: np.random.Generator, size: float, path: Array) -> Values:
    """A gear that is no whole number of turns behind the wheel."""
    return {"torque": size, "wheel": float(rng.integers(4)), "cycles": rng.uniform(1.5, 6.0)}


def rubbing(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"torque": size, "speed": rng.uniform(2.0, 5.0), "width": rng.uniform(0.5, 1.2)}


def strip(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "x": spot(rng, path)[0], "width": rng.uniform(0.08, 0.2)}


def gust(rng: np.random.Generator, size: float, path: Array) -> Values:
    when = {"time": rng.uniform(15.0, 45.0), "width": rng.uniform(4.0, 10.0)}
    return {"force": size, "direction": direction(rng), **when}


def ramp(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "direction": direction(rng), "edge": float(np.median(path[:, 0]))}


def magnet(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"moment": size, "neutral": rng.uniform(-1.0, 1.0)}


def weave(rng: np.random.Generator, size: float, path: Array) -> Values:
    """The floor drags more along one axis of the world than along the other."""
    forces = [size, size * rng.uniform(0.1, 0.5)]
    if rng.random() < 0.5:
        forces.reverse()
    return {"force_x": forces[0], "force_y": forces[1]}


def sticking(rng: np.random.Generator, size: float, path: Array) -> Values:
    where = {"wheel": float(rng.integers(4))}
    return {
        "torque": size,
        **where,
        "speed": rng.uniform(4.0, 10.0),
        "width": rng.uniform(1.5, 4.0),
    }


def lame(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"share": min(size, 0.8), "wheel": float(rng.integers(4)), "phase": direction(rng)}


def failing(rng: np.random.Generator, size: float, path: Array) -> Values:
    when = {"time": rng.uniform(10.0, 30.0)}
    return {"share": min(size, 0.8), "wheel": float(rng.integers(4)), **when}


def jet(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"force": size, "direction": direction(rng), "time": rng.uniform(10.0, 30.0)}


def whirl(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"moment": size, "time": rng.uniform(15.0, 45.0), "width": rng.uniform(4.0, 10.0)}


def any_wheel(name: str) -> Callable[[np.random.Generator, float, Array], Values]:
    return lambda rng, size, path: {name: size, "wheel": float(rng.integers(4))}


def mat(rng: np.random.Generator, size: float, path: Array) -> Values:
    x, y = spot(rng, path)
    return {"stiffness": size, "x": x, "y": y, "radius": rng.uniform(0.25, 0.4)}


def weak(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"share": min(size, 0.7), "edge": rng.uniform(0.1, 0.3)}


def wall(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"stiffness": size, "edge": float(np.quantile(path[:, 0], rng.uniform(0.4, 0.7)))}


def rough(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"torque": size, "edge": float(np.quantile(path[:, 0], rng.uniform(0.4, 0.6)))}


def pile(rng: np.random.Generator, size: float, path: Array) -> Values:
    return {"coefficient": size, "direction": direction(rng)}
