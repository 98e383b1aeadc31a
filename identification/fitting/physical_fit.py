"""A fit within what can be: no mass below that of the wheels, no negative friction, and so on.

Where something is missing from a model, least squares may go beyond all masses and frictions that
exist. The best parameters within the limits are then taken: a model that can be simulated, and with
which a search for what is missing can begin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.least_squares import Fit
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import limits, well_inside

Array = NDArray[np.float64]


def within_limits(mechanism: Mechanism, found: Fit, settings: FitSettings = FitSettings()) -> Fit:
    """The fit with the least squares among those whose model can be.

    A fit that is within the limits is returned as it is. From another one the squares are those of
    the model linearised at its end, exact where the model is linear. ``bounded`` names what stands
    at a limit. The covariance stays that of the free fit.
    """
    if _room(mechanism, found.theta) >= 0:
        return found
    inside = _shrunk(mechanism, found.theta, well_inside(mechanism, found.theta), settings)
    theta = _shrunk(mechanism, _constrained(mechanism, found, inside, settings), inside, settings)
    step = (theta - found.theta)[found.free]
    rows = tuple(replace(r, residual=r.residual - r.columns @ step) for r in found.rows)
    least = settings.limit_room
    names = [name for name, room in limits(mechanism, theta).items() if room < 2 * least]
    known = {mechanism.parameter_names[k]: place for place, k in enumerate(found.free)}
    bounded = {*found.bounded, *(known[name] for name in names if name in known)}
    return replace(found, theta=theta, rows=rows, bounded=tuple(sorted(bounded)))


def _room(mechanism: Mechanism, theta: Array) -> float:
    """The least distance to a limit, in units of the parameters' sizes; negative beyond."""
    return min(limits(mechanism, theta).values(), default=np.inf)


def _shrunk(mechanism: Mechanism, theta: Array, inside: Array, settings: FitSettings) -> Array:
    """The furthest point from ``inside`` on the way to theta that is within the limits."""
    if np.isfinite(theta).all() and _room(mechanism, theta) >= 0:
        return theta
    near, far = 0.0, 1.0
    ahead = np.where(np.isfinite(theta), theta, inside) - inside
    for _ in range(settings.limit_halvings):
        middle = 0.5 * (near + far)
        if _room(mechanism, inside + middle * ahead) >= 0:
            near = middle
        else:
            far = middle
    return inside + near * ahead


def _constrained(mechanism: Mechanism, found: Fit, inside: Array, settings: FitSettings) -> Array:
    """theta (P,) with the least squares within the limits, from a point there."""
    # Imported here: scipy.optimize is slow to load, and few fits reach a limit.
    from scipy.optimize import minimize

    free, scale = found.free, mechanism.scale[found.free]
    columns = np.concatenate([r.columns.reshape(-1, len(free)) for r in found.rows]) / scale
    residual = np.concatenate([r.residual.ravel() for r in found.rows])
    square = max(float(residual @ residual), 1e-300)
    gramian, gradient = columns.T @ columns / square, columns.T @ residual / square
    # What no column shows must stay where it is, or the search wanders.
    gramian += settings.min_singular_value_share * np.trace(gramian) * np.eye(len(free))

    def theta_of(step: Array) -> Array:
        theta = found.theta.copy()
        theta[free] += step / scale
        return theta

    def room(step: Array) -> Array:
        return np.array(list(limits(mechanism, theta_of(step)).values())) - settings.limit_room

    best = minimize(
        lambda step: 0.5 * step @ gramian @ step - gradient @ step,
        (inside - found.theta)[free] * scale,
        jac=lambda step: gramian @ step - gradient,
        constraints={"type": "ineq", "fun": room},
        method="SLSQP",
        options={"maxiter": settings.limit_steps, "ftol": settings.max_converged_square_share},
    )
    return theta_of(best.x) if np.isfinite(best.x).all() else inside
