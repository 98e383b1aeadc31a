"""Wheels that slip: said as such, and no friction is named for it.

A wheel that slides turns faster than it rolls, loses its torque, and comes too short. In forces
that looks like a friction of that wheel, a torque that is mis-scaled, or rollers that are heavy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.diagnosis.structures import FittedStructure, LoggedData
from identification.fitting.kinematic_evidence import SlippingWheels, slip_words
from identification.fitting.noise_bias import joint_fit
from identification.mechanisms.samples import Samples
from youbot_env.physics.effect import CONTACT, SPEED


def does_slip(data: LoggedData, slip: SlippingWheels) -> bool:
    """Whether wheels slip by more than is worth a word."""
    return slip.share > data.settings.fit.kinematics.min_slip_share


def refuted(data: LoggedData, fitted: FittedStructure, slip: SlippingWheels) -> list[str]:
    """Effects of a structure that explain little where no wheel slips.

    Any friction, gain or delay may imitate what slips; forces say little of effects that wheels and
    pose show, so these are doubted only where wheels slip nearly always.
    """
    names = fitted.mechanism.structure.effects
    if not names or not does_slip(data, slip):
        return []
    firm = [_without(item, mask) for item, mask in zip(fitted.samples, slip.slips, strict=True)]
    kept = 1.0 - float(np.mean(np.concatenate(slip.slips)))
    if kept < data.settings.fit.kinematics.min_rest_without_slip:
        return list(names)
    catalogue = fitted.mechanism.catalogue
    doubtful = [name for name in names if catalogue[name].acts_at not in (CONTACT, SPEED)]
    return [name for name in doubtful if not _holds(data, fitted, firm, name)]


def _without(samples: Samples, slips: np.ndarray) -> Samples:
    moves = ~slips if samples.moves is None else samples.moves & ~slips
    return replace(samples, moves=moves)


def _holds(data: LoggedData, fitted: FittedStructure, firm: Sequence[Samples], name: str) -> bool:
    """Whether an effect takes what is needed of the squares of samples that do not slip."""
    settings = data.settings.rows
    others = [other for other in fitted.mechanism.structure.effects if other != name]
    base = fitted.mechanism.with_effects(others)
    known = dict(zip(fitted.mechanism.parameter_names, fitted.theta, strict=True))
    start = np.array([known[key] for key in base.parameter_names])
    without = joint_fit(base, firm, start, settings).square
    square = joint_fit(fitted.mechanism, firm, fitted.theta, settings).square
    return without - square > data.settings.min_share_of_residual * without


def slip_warning(slip: SlippingWheels, refused: Sequence[str]) -> str:
    """What a reader must know of logs whose wheels slip."""
    if not refused:
        return slip_words(slip)
    names = " and ".join(name.replace("_", " ") for name in refused)
    return f"{slip_words(slip)} ({names} would act like it, but not where no wheel slips)"
