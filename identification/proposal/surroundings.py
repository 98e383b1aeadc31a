"""What logs show of a platform's motion, and where the search for shape constants begins there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.proposal.law import Constant, Law, Shapes
from identification.proposal.settings import ProposalSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surroundings:
    """What the logs show of the platform: typical speeds (rms), where it was, and for how long.

    twist (3,), wheel, roller : [m/s, m/s, rad/s], [rad/s]; torque [N m]
    place (n, 2) [m], loud (n,) : where it was, and the squares that are left there
    """

    twist: tuple[float, float, float]
    wheel: float
    roller: float
    torque: float
    place: Array
    loud: Array
    duration: float

    @property
    def speed(self) -> float:
        """Of O [m/s]."""
        return math.hypot(*self.twist[:2]) / math.sqrt(2)


CIRCLE = (-2 * math.pi, 2 * math.pi)


def _directions(count: int, half: bool) -> tuple[float, ...]:
    turn = math.pi if half else 2 * math.pi
    number = count if half else 2 * count
    return tuple(k * turn / number for k in range(number))


def direction_constant(settings: ProposalSettings, half: bool = True) -> Constant:
    values = _directions(settings.directions, half)
    return Constant("direction", "rad", *CIRCLE, 1.0, values)


TURN = "c, s = xp.cos(direction), xp.sin(direction)"

CONFIRM = {
    "direction": "drive along that direction of the floor and across it, at one speed",
    "heading": "turn the robot on the spot, then drive the same line at other headings",
    "place": "drive over the place slowly, both ways, and beside it",
    "speed": "drive at several constant speeds, both ways",
    "wheel": "lift the robot and spin the wheels by hand",
    "roller": "drive slowly sideways: one roller after the other takes the load",
    "time": "record the same motion again, starting at another time",
    "load": "drive one motion gently and briskly",
}


def wave_constants(period: float, direction: float) -> tuple[Constant, ...]:
    """Of what repeats itself along a direction of the floor, near a period [m]."""
    step = 2e-3 * period
    return (
        Constant("period", "m", 0.5 * period, 2.0 * period, period, (period,), step=step),
        Constant("direction", "rad", *CIRCLE, 1.0, (direction,), step=0.02),
    )


WAVE = "turn = 6.283185307179586 * (world.x * c + world.y * s) / period"
"""Angle of such a wave, behind ``TURN``."""


def instants(seen: Surroundings, settings: ProposalSettings) -> tuple[float, ...]:
    inner = np.linspace(0.0, seen.duration, settings.instants + 2)[1:-1]
    return tuple(float(round(t, 2)) for t in inner)


def edge_constant(axis: str, seen: Surroundings, settings: ProposalSettings) -> Constant:
    """An edge [m] across an axis of the floor: tried at quantiles of where the platform was, and
    evenly over its whole reach, since it may have been beyond it for a moment only."""
    places = seen.place[:, "xy".index(axis)]
    low, high = float(places.min()), float(places.max())
    shares = np.linspace(0.0, 1.0, settings.edges + 2)[1:-1]
    tried = np.concatenate([np.quantile(places, shares), low + (high - low) * shares])
    found = sorted({round(float(value), 3) for value in tried})
    return Constant("edge", "m", low, high, 1.0, tuple(found))


def spots(seen: Surroundings, settings: ProposalSettings) -> list[tuple[float, float, float]]:
    """Centres (x, y) and radii [m] of patches and bumps to try: for each radius a grid as fine as
    it, those places where most is left unexplained."""
    found: list[tuple[float, float, float]] = []
    for radius in settings.spot_radii:
        spacing = settings.spot_spacing * radius
        cells = np.round(seen.place / spacing).astype(int)
        places, which = np.unique(cells, axis=0, return_inverse=True)
        squares = np.bincount(which.ravel(), seen.loud)
        order = np.lexsort((places[:, 1], places[:, 0], -squares))[: settings.max_spots]
        found += [(float(x), float(y), radius) for x, y in spacing * places[order]]
    return found


def points(seen: Surroundings, settings: ProposalSettings) -> Iterator[tuple[float, float]]:
    """Points (x, y) from which a force may come: where most is left unexplained, and some about all
    that was passed."""
    radius = sorted(settings.spot_radii)[len(settings.spot_radii) // 2]
    yield from ((x, y) for x, y, r in spots(seen, settings) if r == radius)
    margin, step = settings.point_margin, settings.point_spacing
    x, y = (
        np.arange(low - margin, high + margin + step, step)
        for low, high in zip(seen.place.min(axis=0), seen.place.max(axis=0), strict=True)
    )
    # A bound on time where the platform drove far.
    thin = math.ceil(math.sqrt(len(x) * len(y) / settings.max_spots))
    yield from ((float(a), float(b)) for a in x[::thin] for b in y[::thin])


def walls_ahead(seen: Surroundings, settings: ProposalSettings) -> Iterator[tuple[float, float]]:
    """Walls (way [m], direction [rad]) beyond where the platform has been."""
    for direction in direction_constant(settings, half=False).values:
        reach = float(_ways(seen, direction).max())
        yield from ((reach + way, direction) for way in settings.wall_ways)


def lines_to_cross(seen: Surroundings, settings: ProposalSettings) -> Iterator[tuple[float, float]]:
    """Lines (way [m], direction [rad]) that the platform has crossed, each seen from both sides."""
    yield from _lines(seen, 2 * settings.line_directions, 2 * math.pi, settings)


def lines_to_follow(
    seen: Surroundings, settings: ProposalSettings
) -> Iterator[tuple[float, float]]:
    """The same, each once: of a strip it is the same from both sides."""
    yield from _lines(seen, settings.line_directions, math.pi, settings)


def streams(seen: Surroundings, settings: ProposalSettings) -> Iterator[tuple[float, float]]:
    """Middle [m] and direction [rad] of streams: the middle lies to their left."""
    for way, across in lines_to_follow(seen, settings):
        yield way, across - 0.5 * math.pi


def _lines(
    seen: Surroundings, count: int, turn: float, settings: ProposalSettings
) -> Iterator[tuple[float, float]]:
    """At quantiles of where the platform was along each direction, and evenly over its reach."""
    for direction in turn * np.arange(count) / count:
        ways, shares = _ways(seen, direction), np.array(settings.line_shares)
        even = ways.min() + (ways.max() - ways.min()) * shares
        tried = np.concatenate([np.quantile(ways, shares), even])
        yield from ((float(way), float(direction)) for way in tried)


def _ways(seen: Surroundings, direction: float) -> Array:
    return seen.place @ [math.cos(direction), math.sin(direction)]


SPOT = ("spot_x", "spot_y", "radius")

TOGETHER: dict[
    tuple[str, ...], Callable[[Surroundings, ProposalSettings], Iterable[tuple[float, ...]]]
] = {
    SPOT: spots,
    ("point_x", "point_y"): points,
    ("line", "direction"): lines_to_cross,
    ("edge", "across"): lines_to_cross,
    ("centre", "across"): lines_to_follow,
    ("wall", "direction"): walls_ahead,
    ("stream", "direction"): streams,
}
"""Shape constants that are tried together, at places that the logs suggest."""


def choices_of(law: Law, seen: Surroundings, settings: ProposalSettings) -> Iterator[Shapes]:
    """The values of its shape constants at which a law is tried: all combinations, of those that
    say where it acts at places that the logs suggest."""
    names = [c.name for c in law.shapes]
    together = next((group for group in TOGETHER if set(group) <= set(names)), ())
    places = list(TOGETHER[together](seen, settings)) if together else [()]
    first = names.index(together[0]) if together else 0
    for others in itertools.product(*(c.values for c in law.shapes if c.name not in together)):
        for place in places:
            yield (*others[:first], *place, *others[first:])


def choices_near(law: Law, leader: Law, settings: ProposalSettings) -> Iterator[Shapes]:
    """The values at which a law of a spot alone is tried where another law has found one: about
    its middle, with several radii."""
    x, y, radius = (c.values[0] for c in leader.shapes if c.name in SPOT)
    assert tuple(c.name for c in law.shapes) == SPOT
    off = settings.spot_offset * radius
    for dx, dy in ((0.0, 0.0), (off, 0.0), (-off, 0.0), (0.0, off), (0.0, -off)):
        for share in settings.spot_radius_shares:
            yield x + dx, y + dy, share * radius


def spot_constants(seen: Surroundings, settings: ProposalSettings) -> tuple[Constant, ...]:
    """Of a spot; what is tried of them is told by :func:`spots`."""
    low, high = float(seen.place.min()) - 0.5, float(seen.place.max()) + 0.5
    return (
        Constant("spot_x", "m", low, high, 1.0, (0.0,)),
        Constant("spot_y", "m", low, high, 1.0, (0.0,)),
        Constant("radius", "m", 0.03, 2.0, 0.3, settings.spot_radii),
    )
