"""Laws of the grammar for tests, at values that logs of a platform suggest."""

from __future__ import annotations

from functools import cache

import numpy as np

from identification.proposal import (
    periodic_laws,
    place_laws,
    platform_laws,
    products,
    sized_friction,
)
from identification.proposal.law import FoundLaw, Law
from identification.proposal.settings import ProposalSettings
from identification.proposal.surroundings import Surroundings

SETTINGS = ProposalSettings()

SWINGS = (
    periodic_laws.SWAY,
    periodic_laws.SWAY_AND_TURN,
    periodic_laws.SWINGING_MOMENT,
    periodic_laws.SHAKE,
)


@cache
def seen() -> Surroundings:
    """Of a platform that drove through three metres of floor."""
    rng = np.random.default_rng(0)
    place = rng.uniform(-1.5, 1.5, (500, 2))
    return Surroundings((0.1, 0.1, 0.5), 4.0, 12.0, 0.6, place, np.ones(500), 60.0)


@cache
def every_law() -> tuple[Law, ...]:
    """Single ones, products of two, and those that repeat themselves."""
    laws = platform_laws.single_laws(seen(), SETTINGS)
    factors = products.canonical_factors(seen(), SETTINGS)
    laws += [p for law in factors for p in products.products(law, seen(), SETTINGS)]
    laws += place_laws.laws_at_a_spot(seen(), SETTINGS)
    laws += place_laws.fields_at_a_spot(seen(), SETTINGS)
    laws += [periodic_laws.ripple_over_floor(0.1, 0.3)]
    laws += sized_friction.stripes(seen(), 0.1, 0.3)
    laws += [periodic_laws.swinging(swing, 3.7) for swing in SWINGS]
    for ripple in (periodic_laws.ripple_of_wheels, periodic_laws.ripple_of_rollers):
        laws += [ripple(7.3, each) for each in (False, True)]
    return tuple(laws)


def at_some_size(law: Law) -> FoundLaw:
    """The law at strengths of one and the first of its shape constants."""
    values = {name: 1.0 for c in law.strengths for name in c.names}
    for c in law.constants:
        if not c.is_shape:
            values |= dict.fromkeys(c.names, float(np.clip(1.0, c.lower, c.upper)))
    return FoundLaw(law, values | {c.name: c.values[len(c.values) // 2] for c in law.shapes})
