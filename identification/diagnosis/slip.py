"""Wheels that slip: said as such, and no friction is named for it.

A wheel that slides turns faster than it rolls, loses its torque, and comes too short. In forces
that looks like a friction of that wheel, a torque that is mis-scaled, or rollers that are heavy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.diagnosis.structures import FittedStructure, LoggedData
from identification.fitting.kinematic_evidence import SlippingWheels, TellingSlip
from identification.fitting.noise_bias import joint_fit
from identification.fitting.regression import Regression
from identification.logs.timebase import runs_of
from identification.mechanisms.samples import Samples

Array = NDArray[np.float64]


def telling_slip(
    fitted: FittedStructure, slip: SlippingWheels, imitators: Sequence[str] = ()
) -> TellingSlip | None:
    """The slip of wheels, if it is worth a word: lasting, or bursts in which the structure fails.

    A wheel that slides loses its pull, so the forces fail as the speeds do. Rollers that ripple
    break the speeds' identity too, and no force fails then.

    ``imitators``: names of effects that act as the slip does, see :func:`refuted`
    """
    settings = fitted.settings
    if slip.share > settings.fit.kinematics.min_slip_share:
        return TellingSlip(
            slip.share, swings=slip.swings, late=slip.late, imitators=tuple(imitators)
        )
    bursts, elsewhere, seconds = list[float](), list[Array](), 0.0
    for samples, row, mask in zip(fitted.samples, fitted.rows, slip.bursts, strict=True):
        within = _remembered(samples, row, mask, settings.regime.filter_memory)
        square = (row.residual**2).sum(axis=1)
        bursts += [float(square[start:stop].mean()) for start, stop in runs_of(within)]
        elsewhere.append(square[~within])
        seconds += len(samples) * samples.dt
    rest = np.concatenate(elsewhere)
    if not bursts or not len(rest):
        return None
    ratios = np.array(bursts) / max(float(rest.mean()), 1e-300)
    failing = int((ratios > settings.min_burst_square_ratio).sum())
    enough = max(settings.min_bursts, settings.min_burst_rate * seconds)
    # Most of them: where something else is missing, some bursts meet it by chance.
    if failing < enough or np.median(ratios) <= settings.min_burst_square_ratio:
        return None
    return TellingSlip(slip.share, failing, float(np.median(ratios)), imitators=tuple(imitators))


def _remembered(
    samples: Samples, row: Regression, mask: NDArray[np.bool_], memory: float
) -> NDArray[np.bool_]:
    """(n,) rows that remember a sample of the mask (N,), through the filter."""
    count = np.concatenate([[0], np.cumsum(mask)])
    ends = np.searchsorted(samples.time, row.time, side="right")
    starts = np.searchsorted(samples.time, row.time - row.step - memory)
    return count[ends] > count[starts]


def refuted(data: LoggedData, fitted: FittedStructure, slip: SlippingWheels) -> list[str]:
    """Effects of a structure that explain little where no wheel slips.

    Any friction, gain, delay or roller angle may imitate what slips.
    """
    names = fitted.mechanism.structure.effects
    if not names or telling_slip(fitted, slip) is None:
        return []
    firm = [_without(item, mask) for item, mask in zip(fitted.samples, slip.slips, strict=True)]
    kept = 1.0 - float(np.mean(np.concatenate(slip.slips)))
    if kept < data.settings.fit.kinematics.min_rest_without_slip:
        return list(names)
    return [name for name in names if not _holds(data, fitted, firm, name)]


def _without(samples: Samples, slips: np.ndarray) -> Samples:
    moves = ~slips if samples.moves is None else samples.moves & ~slips
    return replace(samples, moves=moves)


def _holds(data: LoggedData, fitted: FittedStructure, firm: Sequence[Samples], name: str) -> bool:
    """Whether an effect takes as much of the squares where no wheel slips as it does in all.

    What slips is an error of its own: without it a real effect is a larger part of what is left.
    """
    settings = data.settings
    least = max(settings.min_share_of_residual, settings.min_share_on_grip * _share(fitted, name))
    return _share(fitted, name, firm) >= least


def _share(fitted: FittedStructure, name: str, samples: Sequence[Samples] | None = None) -> float:
    """Share that an effect takes of the squares which the structure's other effects leave.

    ``samples`` : by default those that the structure was fitted to
    """
    samples, settings = samples or fitted.samples, fitted.settings.rows
    others = [other for other in fitted.mechanism.structure.effects if other != name]
    base = fitted.mechanism.with_effects(others)
    known = dict(zip(fitted.mechanism.parameter_names, fitted.theta, strict=True))
    start = np.array([known[key] for key in base.parameter_names])
    without = joint_fit(base, samples, start, settings).square
    square = joint_fit(fitted.mechanism, samples, fitted.theta, settings).square
    return 1.0 - square / without
