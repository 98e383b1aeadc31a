"""Where what a diagnosis leaves unexplained lives."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.structures import LoggedData, Step
from identification.fitting.regression import regression
from identification.residual_map.regime import Regime, find_regime


def regime_left(
    data: LoggedData, steps: tuple[Step, ...], share: float | None
) -> tuple[tuple[Step, ...], Regime | None]:
    """The steps that hold beside it, and where what is left lives, if a rule says so.

    Where the base model leaves no more than noise outside of a rule, nothing is missing there.
    Effects that are accepted all the same act there too: they imitate what acts inside.

    ``share``: of what could be explained that the effects take; None where nothing could.
    """
    first = _regime_of(data, steps[0])
    if first is None:
        return steps, _regime_of(data, steps[-1]) if len(steps) > 1 else None
    imitate = share is not None and share < data.settings.max_imitators_share
    return (steps[:1] if imitate else steps), first


def _regime_of(data: LoggedData, step: Step) -> Regime | None:
    """Where what a structure leaves lives."""
    fitted, settings = step.fitted, data.settings
    rows = [
        regression(fitted.mechanism, fitted.theta, item, fitted.free, settings.fit)
        for item in data.samples
    ]
    known = step.predictable
    # Where it rests there is neither noise nor anything else.
    moves = [(residual != 0).any(axis=1) for residual in known.residual]
    noise = np.concatenate([known.noise(k)[rows_of] for k, rows_of in enumerate(moves)])
    level = float((noise**2).sum(axis=1).mean())
    return find_regime(fitted.mechanism, rows, data.samples, level, settings.regime, settings.fit)
