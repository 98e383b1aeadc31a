"""Which laws are tried of a mechanism: its grammar, at values that its logs suggest."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.samples import Samples
from identification.proposal import (
    periodic_laws,
    place_laws,
    platform_laws,
    products,
    sized_friction,
)
from identification.proposal.axis_laws import Travel, axis_laws
from identification.proposal.evidence import Evidence, Scene
from identification.proposal.law import Law, Shapes
from identification.proposal.periods import cycles_of_angles, periods_over_floor
from identification.proposal.surroundings import Surroundings, choices_near, choices_of
from youbot_env.physics.effect import ROLLER, WHEEL, Place

Array = NDArray[np.float64]
Choices = Iterable[Shapes]


class Grammar(Protocol):
    """The laws of a mechanism, each with the values at which its shape constants are tried."""

    def single(self) -> list[tuple[Law, Choices]]:
        """Laws of one variable."""
        ...

    def periodic(self) -> list[tuple[Law, Choices]]:
        """Laws that repeat themselves, near what a scan over all periods shows."""
        ...

    def like(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """Other laws of what the best show: at the same spot of the floor."""
        ...

    def products(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """Laws that act in a part of the motion alone, made of the best of one variable."""
        ...


class PlatformGrammar:
    """The laws of a mecanum platform."""

    def __init__(self, evidence: Evidence, samples: Sequence[Samples]) -> None:
        self.evidence, self.settings = evidence, evidence.settings
        self.seen = surroundings(evidence, samples)

    def single(self) -> list[tuple[Law, Choices]]:
        """Laws of one variable."""
        return self._with_choices(platform_laws.single_laws(self.seen, self.settings))

    def periodic(self) -> list[tuple[Law, Choices]]:
        """Ripples of the floor and of the wheels, and friction that the floor has in stripes."""
        laws = [periodic_laws.ripple_over_floor(*wave) for wave in self._periods(_of_world)]
        for wave in self._periods(self._against_motion):
            laws += sized_friction.stripes(self.seen, *wave)
        if not any(item.own_clock for item in self.evidence.mechanism.structure.components):
            laws += [
                periodic_laws.swinging(swing, period)
                for swings, forces in self._swings()
                for period in self._periods_in_time(forces)
                for swing in swings
            ]
        laws += [
            ripple(cycles, each)
            for ripple, found in (
                (periodic_laws.ripple_of_wheels, self._cycles(self._wheel_torques)),
                (periodic_laws.ripple_of_rollers, self._cycles(self._roller_powers)),
            )
            for cycles in found
            for each in (False, True)
        ]
        return self._with_choices(laws)

    def _periods(self, part_of: Callable[[Scene, Array], Array]) -> list[tuple[float, float]]:
        """Periods [m] and directions [rad] of a part of the force that is left, over the floor."""
        scenes = self.evidence.scenes
        parts = [part_of(scene, back) for scene, back in zip(scenes, self._back, strict=True)]
        place = np.concatenate([scene.pose[:, :2] for scene in scenes])
        speed = np.concatenate([np.hypot(*scene.twist[:, :2].T) for scene in scenes])
        rate = self.evidence.mechanism.filter_rate
        return periods_over_floor(place, np.concatenate(parts), speed, rate, self.settings)

    def _against_motion(self, scene: Scene, back: Array) -> Array:
        """(N, 1) against the motion: of a friction whose size repeats itself this does."""
        speed = np.hypot(*scene.twist[:, :2].T)
        power = (back[:, :2] * scene.twist[:, :2]).sum(axis=1)
        return (power / np.maximum(speed, self.settings.slowest_share * speed.max()))[:, None]

    def _swings(self) -> list[tuple[tuple[periodic_laws.Swing, ...], list[Array]]]:
        """What may swing in time, with the forces (N, k) of each log in which its period is
        sought."""
        pairs = list(zip(self.evidence.scenes, self._back, strict=True))
        of_world = [_of_world(scene, back) for scene, back in pairs]
        along, moments = [b[:, :2] for b in self._back], [b[:, 2:] for b in self._back]
        return [
            ((periodic_laws.SWAY, periodic_laws.SWAY_AND_TURN), of_world),
            ((periodic_laws.SWINGING_MOMENT, periodic_laws.SWAY_AND_TURN), moments),
            ((periodic_laws.SHAKE,), along),
        ]

    def _periods_in_time(self, forces: Sequence[Array]) -> list[float]:
        """Periods [s] of the strongest forces (N, k) of each log that repeat themselves in time,
        wherever in its period a log began."""
        scenes, unit = self.evidence.scenes, self.settings.unit_of_time
        pairs = [
            (2 * np.pi / unit * scene.time, part)
            for scene, force in zip(scenes, forces, strict=True)
            for part in force.T
        ]
        found = cycles_of_angles(
            *([time for time, _ in pairs], [part for _, part in pairs]),
            *(np.full(1, 2 * np.pi / unit), self.evidence.mechanism.filter_rate, self.settings),
        )
        return [unit / cycles for cycles in found]

    def _cycles(self, torques: Sequence[Array]) -> list[float]:
        """Cycles a turn of torques (N,), one a wheel, that repeat themselves with its angle."""
        mechanism, scenes = self.evidence.mechanism, self.evidence.scenes
        angles = [
            np.concatenate([scene.angle[:, i] for scene in scenes]) for i in range(len(torques))
        ]
        speed = np.concatenate([scene.wheel_speed.ravel() for scene in scenes])
        return cycles_of_angles(angles, torques, speed, mechanism.filter_rate, self.settings)

    @property
    def _wheel_torques(self) -> list[Array]:
        """What is left (N,), as torques of each wheel joint."""
        return [np.concatenate(self._along(unit)) for unit in self._units(WHEEL)]

    @property
    def _roller_powers(self) -> list[Array]:
        """What is left (N,), as torques of each roller times its rate: of a friction whose size
        swings this swings as its size does."""
        jacobian = self.evidence.mechanism.geometry.roller_jacobian
        rates = [scene.twist @ jacobian.T for scene in self.evidence.scenes]
        return [
            np.concatenate(
                [t * rate[:, i] for t, rate in zip(self._along(unit), rates, strict=True)]
            )
            for i, unit in enumerate(self._units(ROLLER))
        ]

    def _units(self, place: Place) -> list[Array]:
        """Force (A,) of a unit torque at each joint of a site."""
        mechanism = self.evidence.mechanism
        joints = range(len(mechanism.joints))
        points = self.evidence.scenes[0].points[0]
        force = mechanism.kind.sites[place].force
        return [np.array(force(points, tuple(float(k == i) for k in joints))) for i in joints]

    def _along(self, unit: Array) -> list[Array]:
        """Per log (N,), what is left as a torque that makes the force ``unit``."""
        return [back @ unit for back in self._back]

    @cached_property
    def _back(self) -> list[Array]:
        return self.evidence.taken_back()

    def like(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """Forces of other shapes about the spot that a bump, or a force about a spot, found."""
        others = {
            place_laws.BUMP: place_laws.laws_at_a_spot,
            place_laws.SPOT_FIELD: place_laws.fields_at_a_spot,
        }
        return [
            (law, list(choices_near(law, leader, self.settings)))
            for leader in leaders
            if leader.name in others
            for law in others[leader.name](self.seen, self.settings)
        ]

    def products(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """Laws of the world in a patch, beyond an edge, from a time on."""
        known = products.canonical_factors(self.seen, self.settings)
        factors = {law.name: law for law in known}
        factors |= {law.name: law for law in leaders if law.terms <= self.settings.max_factor_terms}
        return self._with_choices(
            [
                law
                for factor in factors.values()
                for law in products.products(factor, self.seen, self.settings)
            ]
        )

    def _with_choices(self, laws: Sequence[Law]) -> list[tuple[Law, Choices]]:
        return [(law, list(choices_of(law, self.seen, self.settings))) for law in laws]


def _of_world(scene: Scene, back: Array) -> Array:
    """(N, 2) along the world: the transpose of the way from there to a force on the body."""
    c, s = np.cos(scene.pose[:, 2]), np.sin(scene.pose[:, 2])
    return np.column_stack([c * back[:, 0] - s * back[:, 1], s * back[:, 0] + c * back[:, 1]])


def surroundings(evidence: Evidence, samples: Sequence[Samples]) -> Surroundings:
    """What the logs show of a platform's motion."""
    twist = np.concatenate([item.twist for item in samples])
    jacobian = evidence.mechanism.geometry.roller_jacobian
    return Surroundings(
        (_rms(twist[:, 0]), _rms(twist[:, 1]), _rms(twist[:, 2])),
        _rms(np.concatenate([item.wheel_speed for item in samples])),
        _rms(twist @ jacobian.T),
        _rms(np.concatenate([item.torque for item in samples])),
        *evidence.loud_places(),
        max(float(item.time[-1]) for item in samples),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


class AxisGrammar:
    """The laws of one axis that slides or turns."""

    def __init__(self, evidence: Evidence, samples: Sequence[Samples]) -> None:
        self.settings, mechanism = evidence.settings, evidence.mechanism
        places = np.concatenate([item.pose[:, 0] for item in samples])
        shares = np.linspace(0.0, 1.0, self.settings.edges + 2)
        where = tuple(float(v) for v in np.quantile(places, shares))
        values = dict(zip(mechanism.parameter_names, evidence.theta.tolist(), strict=True))
        duration = max(float(item.time[-1]) for item in samples)
        self.seen = Travel(mechanism.geometry, where, duration, values["smoothing"])

    def single(self) -> list[tuple[Law, Choices]]:
        """All of them."""
        laws = axis_laws(self.seen, self.settings)
        return [(law, list(itertools.product(*(c.values for c in law.shapes)))) for law in laws]

    def periodic(self) -> list[tuple[Law, Choices]]:
        """None: a force that repeats itself along the travel is in the catalogue."""
        return []

    def like(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """None: an axis has no spots but tight ones, which are among its laws."""
        return []

    def products(self, leaders: Sequence[Law]) -> list[tuple[Law, Choices]]:
        """None: those that an axis has are among its laws."""
        return []


GRAMMARS: dict[str, Callable[[Evidence, Sequence[Samples]], Grammar]] = {
    "mecanum": PlatformGrammar,
    "axis": AxisGrammar,
}
"""Of each kind of mechanism, by its name; no law is proposed for others."""
