"""What an ideal motion of a mecanum platform shows of the base model: the paper's statements."""

from __future__ import annotations

import numpy as np

from identification.fitting.observability import Observability, observability
from identification.fitting.settings import FitSettings
from identification.mechanisms.paper_regressor import BASE, PAPER_ORDER, ideal_columns
from youbot_env.motions.base import Motion
from youbot_env.physics.geometry import Geometry


def motion_observability(
    motion: Motion,
    geometry: Geometry | None = None,
    *,
    window: tuple[float, float] | None = None,
    blind: float = FitSettings.ideal_blind_eigenvalue,
    dt: float = 0.005,
) -> Observability:
    """What an ideal motion shows of the base model, without a filter: the paper's statements.

    Parameters
    ----------
    window : start and end [s]; a periodic motion should be given whole periods
    """
    start, end = window or (0.0, motion.duration)
    # Half a step less: the end of a period is the start of the next one and must not count twice.
    time = np.arange(start, end - 0.5 * dt, dt)
    columns = ideal_columns(geometry or Geometry(), motion.twist(time), motion.acceleration(time))
    names = [BASE.parameter_names[k] for k in PAPER_ORDER]
    return observability(names, columns, dt, blind=blind)
