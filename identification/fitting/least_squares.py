"""Batch least squares on filtered forces, with standard deviations for correlated residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.regression import (
    Indices,
    Regression,
    acting_share,
    covariance_of,
    filtered_residual,
    regressions,
)
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from youbot_env.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """Result of a least-squares fit.

    theta (P,): all parameters, shape constants included; free (F,): indices of the fitted ones;
    covariance (F, F): true for correlated residuals; rows: residual and columns at theta, per log;
    bounded: indices of parameters that stopped at a physical bound;
    in_free_run: whether the rows are those of an output-error fit;
    acting_share: squares of the force that acts, over those of the logged one.
    """

    theta: Array
    free: Indices
    covariance: Array
    rows: tuple[Regression, ...]
    bounded: tuple[int, ...] = ()
    in_free_run: bool = False
    acting_share: float = 1.0

    @property
    def std(self) -> Array:
        """(F,) standard deviations of the free parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def square(self) -> float:
        """Sum of the squared residuals of all rows, scaled to the force that was logged."""
        return float(sum((row.residual**2).sum() for row in self.rows)) / self.acting_share


def fit(
    mechanism: Mechanism,
    logs: Sequence[Samples],
    start: Array,
    *,
    free: NDArray[np.bool_] | None = None,
    first: Sequence[Regression] | None = None,
    robust: bool = False,
    settings: FitSettings = FitSettings(),
    progress: Callable[[], None] = lambda: None,
) -> Fit:
    """Fit the free parameters; the others stay at their values in ``start``.

    Gauss-Newton on the filtered force residual, as a share of the force that acts: one step where
    the model is linear.

    Parameters
    ----------
    start : (P,) theta to start from
    free : (P,) which parameters are fitted; by default all but shape constants
    first : the logs' regression rows at ``start``, where they are at hand already
    robust : Huber weights on rows, for logs with outliers

    Raises
    ------
    InputError
        If the logs are too short for the filter to settle, or nothing can be fitted.
    """
    search = _GaussNewton(mechanism, logs, free, robust, settings)
    best = search.run(np.array(start, float), first, progress)
    # The covariance of a robust fit is that of the weighted least-squares estimate.
    weighted = [_weighted(*pair) for pair in zip(best.rows, best.weights, strict=True)]
    scale = mechanism.scale[search.chosen]
    covariance = covariance_of(weighted, search.basis, scale, settings)
    args = (best.theta, search.chosen, covariance, best.rows, best.bounded)
    return Fit(*args, acting_share=best.acting_share)


@dataclass(frozen=True)
class _Iterate:
    """A point of the search: theta (P,), its rows, their weights (n,) and weighted squares.

    acting_share : of the force; the squares are divided by it
    """

    theta: Array
    rows: tuple[Regression, ...]
    weights: tuple[Array, ...]
    square: float
    bounded: tuple[int, ...]
    acting_share: float


class _GaussNewton:
    """The search for the least squares of some logs."""

    def __init__(
        self,
        mechanism: Mechanism,
        logs: Sequence[Samples],
        free: NDArray[np.bool_] | None,
        robust: bool,
        settings: FitSettings,
    ) -> None:
        mask = mechanism.free if free is None else free
        self.mechanism, self.logs = mechanism, logs
        self.robust, self.settings = robust, settings
        self.chosen = np.flatnonzero(mask)
        self.basis = gauge_basis(mechanism, self.chosen)
        # A fitted shape constant makes a linear mechanism nonlinear.
        self.linear = mechanism.is_linear and np.array_equal(mask, mechanism.free)

    def run(
        self, start: Array, first: Sequence[Regression] | None, progress: Callable[[], None]
    ) -> _Iterate:
        """Search until it converges or no longer improves; return the best iterate."""
        settings = self.settings
        here = self.at(start, rows=first)
        if sum(map(len, here.weights)) < settings.min_rows_per_parameter * len(self.chosen):
            raise InputError("the logs are too short to fit a model: record some 20 s of motion")
        # Infinite, so that the first iterate counts as a fall.
        best, waited = replace(here, square=np.inf), 0
        for _ in range(settings.max_steps):
            progress()
            fell = here.square < (1 - settings.min_fall_share) * best.square
            waited = 0 if fell else waited + 1
            best = here if here.square < best.square else best
            if waited > settings.max_steps_without_fall:
                break
            # "not <" is also true for NaN. Go halfway back to the best iterate.
            if not here.square < settings.max_square_ratio * best.square:
                here = self.at(0.5 * (here.theta + best.theta), here.bounded)
                continue
            here, arrived = self.step(here)
            if arrived:
                return here
        return best

    def at(
        self,
        theta: Array,
        bounded: tuple[int, ...] = (),
        rows: Sequence[Regression] | None = None,
    ) -> _Iterate:
        """The iterate at theta (P,), whose rows are computed unless they are known."""
        rows = rows or regressions(self.mechanism, theta, self.logs, self.chosen, self.settings)
        weights = (
            huber_weights(rows, self.settings.huber_threshold)
            if self.robust
            else [np.ones(len(row.residual)) for row in rows]
        )
        share = acting_share(self.mechanism, theta, self.logs)
        square = _squares(rows, weights) / share
        return _Iterate(theta, tuple(rows), tuple(weights), square, bounded, share)

    def step(self, here: _Iterate) -> tuple[_Iterate, bool]:
        """The next iterate, and whether the search has arrived with it."""
        step, bounded = solve_step(
            *(self.mechanism, here.rows, here.weights, here.theta, self.chosen, self.basis),
            self.settings,
        )
        most = self.settings.max_converged_square_share * here.square * here.acting_share
        arrived = _squares_of_step(here, step) < most
        known = None
        # The weights of a robust fit change from step to step, and its squares with them.
        if self._is_inside(here.theta) and not (self.linear or arrived or self.robust):
            share = self._falling_share(here, step)
            if share is None:
                return here, True
            step = share * step
            bounded = self._at_bounds(here.theta[self.chosen] + step, bounded)
        theta = here.theta.copy()
        theta[self.chosen] += step
        if self.linear or arrived:
            # The linear prediction replaces a new evaluation: it is exact for a linear model, and
            # good enough for a step this small.
            known = [replace(r, residual=r.residual - r.columns @ step) for r in here.rows]
        # A robust fit goes on: its weights depend on the residual, also where the model is linear.
        return self.at(theta, bounded, known), arrived or (self.linear and not self.robust)

    def _is_inside(self, theta: Array) -> bool:
        """Whether theta (P,) is within bounds: from outside (no lag at all, say) a step goes in."""
        lower, upper = self.mechanism.bounds
        inside = (lower <= theta) & (theta <= upper)
        return bool(inside[self.chosen].all())

    def _falling_share(self, here: _Iterate, step: Array) -> float | None:
        """The first share of a step that lowers the squares; None if no share does.

        A full step overshoots where the columns turn quickly (the knee of a friction, a period).
        Only residuals are computed: columns cost as much for each parameter.
        """
        theta = here.theta.copy()
        for share in self.settings.step_shares:
            theta[self.chosen] = here.theta[self.chosen] + share * step
            squares = (
                w @ (filtered_residual(self.mechanism, theta, samples, self.settings) ** 2).sum(1)
                for w, samples in zip(here.weights, self.logs, strict=True)
            )
            # Also false for NaN, where the model breaks down.
            if sum(squares) < here.square * acting_share(self.mechanism, theta, self.logs):
                return share
        return None

    def _at_bounds(self, values: Array, bounded: tuple[int, ...]) -> tuple[int, ...]:
        """Those of the fitted parameters that a shortened step has left at their bounds."""
        lower, upper = (bound[self.chosen] for bound in self.mechanism.bounds)
        return tuple(k for k in bounded if np.isclose(values[k], (lower[k], upper[k])).any())


def _squares_of_step(here: _Iterate, step: Array) -> float:
    """Weighted sum of squares of the change that a step makes to the prediction."""
    moved = ((row.columns @ step) ** 2 for row in here.rows)
    return float(sum(w @ part.sum(axis=1) for w, part in zip(here.weights, moved, strict=True)))


def _squares(rows: Sequence[Regression], weights: Sequence[Array]) -> float:
    squares = ((row.residual**2).sum(axis=1) for row in rows)
    return float(sum(w @ part for w, part in zip(weights, squares, strict=True)))


def _weighted(rows: Regression, weight: Array) -> Regression:
    root = np.sqrt(weight)
    return replace(
        rows, residual=rows.residual * root[:, None], columns=rows.columns * root[:, None, None]
    )


def solve_step(
    mechanism: Mechanism,
    rows: Sequence[Regression],
    weights: Sequence[Array],
    theta: Array,
    free: Indices,
    basis: Array,
    settings: FitSettings = FitSettings(),
) -> tuple[Array, tuple[int, ...]]:
    """Least-squares step (F,), within physical bounds if the free step would leave them."""
    scale = mechanism.scale[free]
    parts = [_weighted(row, weight) for row, weight in zip(rows, weights, strict=True)]
    matrix = np.concatenate([p.columns.reshape(-1, len(free)) for p in parts]) / scale
    right = np.concatenate([p.residual.ravel() for p in parts])
    directions = scale[:, None] * basis
    # Unit length: one cut-off of the singular values then has the same meaning for each direction.
    directions = directions / np.linalg.norm(directions, axis=0)
    rounding = settings.min_singular_value_share
    solution, *_ = np.linalg.lstsq(matrix @ directions, right, rcond=rounding)
    step = directions @ solution / scale
    lower, upper = mechanism.bounds
    outside = (theta[free] + step < lower[free]) | (theta[free] + step > upper[free])
    if not outside.any():
        return step, ()
    # What no direction reaches is held where it is.
    still = ~directions.any(axis=1)
    low = np.where(still, theta[free], lower[free])
    return _bounded_step(
        *(matrix, right, scale, theta[free], low, np.where(still, theta[free], upper[free])),
        _unseen(directions),
        settings,
    )


def _unseen(directions: Array) -> Array:
    """(F, F) projection on what no combination of directions (F, Q) reaches."""
    frame, _ = np.linalg.qr(directions)
    return np.eye(len(frame)) - frame @ frame.T


def _bounded_step(
    matrix: Array,
    right: Array,
    scale: Array,
    value: Array,
    lower: Array,
    upper: Array,
    unseen: Array,
    settings: FitSettings,
) -> tuple[Array, tuple[int, ...]]:
    # Imported here: scipy.optimize is slow to load, and few fits reach a bound.
    from scipy.optimize import lsq_linear

    box = ((lower - value) * scale, (upper - value) * scale)
    inside = np.clip(value, lower, upper) - value
    # lsq_linear refuses a box that rounding has made empty or without width.
    box = (np.minimum(box[0], inside * scale), np.maximum(box[1], inside * scale) + 1e-300)
    # The triangle of a QR decomposition has the same least squares in as many rows as parameters;
    # lsq_linear decomposes all rows again at each of its iterations.
    _, triangle = np.linalg.qr(np.column_stack([matrix, right]))
    # Bounds are on each parameter, so the step cannot be sought in directions that data can see.
    # What they cannot see (the common part of relative parameters) stays where it is, since it
    # costs more than the fit could gain by it: on such parts there are no bounds.
    weight = settings.unseen_weight_share * np.linalg.norm(triangle[:, :-1])
    triangle = np.vstack([triangle, weight * np.column_stack([unseen, np.zeros(len(unseen))])])
    with np.errstate(over="ignore", invalid="ignore"):
        # From a value that rounding has left beside its bound, lsq_linear also tries a step that it
        # cannot compute; it takes another one.
        result = lsq_linear(triangle[:, :-1], triangle[:, -1], bounds=box)
    active = tuple(int(k) for k in np.flatnonzero(result.active_mask))
    return result.x / scale, active


def huber_weights(rows: Sequence[Regression], threshold: float) -> list[Array]:
    """One weight a row (n,): full inside Huber's threshold, falling as 1/size outside.

    ``threshold``: in robust standard deviations.
    """
    size = [np.sqrt((row.residual**2).mean(axis=1)) for row in rows]
    # 0.888: median of the root mean square of three standard normal variables. Division by it
    # makes sigma their standard deviation.
    sigma = np.median(np.concatenate(size)) / 0.888
    return [np.minimum(1.0, threshold * sigma / np.maximum(s, 1e-300)) for s in size]
