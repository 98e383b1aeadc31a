"""Baselines that learn what the base model leaves: a sparse combination of a library, and trees.

Sparse regression: sequentially thresholded least squares (Brunton, Proctor and Kutz, PNAS 113(15),
2016) on the discrepancy of a known model (Kaheman and others, 2019), by pysindy (extra ``sindy``).
Trees: scikit-learn's histogram gradient boosting. Both see the same filtered rows as the diagnosis.
"""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.least_squares import fit
from identification.fitting.regression import regression
from identification.fitting.settings import FitSettings
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.samples import Samples
from identification.proposal.evidence import Scene
from identification.proposal.settings import ProposalSettings
from youbot_env.errors import optional_library
from youbot_env.model.model import Model

Array = NDArray[np.float64]

LEAST_SHARE = 0.05
"""Of the residual's squares, held out, under which nothing is missing; of a term, not named."""

ALIKE = 1.1
"""Times the least squares left, held out, up to which a sparser combination is taken."""

THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
"""Tried: share of the residual's rms under which a term of the library is dropped."""

WIDTHS = (0.01, 0.02, 0.03)
"""Of a sign of a speed [m/s], a yaw rate, a wheel's rate [rad/s]."""


@dataclass(frozen=True)
class Term:
    """A column of the library: a name of the catalogue ("": none), its site and variable."""

    effect: str
    site: str
    variable: str


@dataclass(frozen=True)
class Learned:
    """What a baseline has learned.

    effects, law : of the terms that matter, those with a name, and the first one without
    torques : (N, 4) [N m] predicted for a motion
    """

    verdict: str
    torques: Callable[[Log], Array]
    effects: tuple[str, ...] = ()
    law: dict[str, Any] | None = None


@dataclass(frozen=True)
class _Base:
    """The base model fitted to logs, and its rows."""

    mechanism: Mechanism[Any]
    theta: Array
    samples: tuple[Samples, ...]
    scenes: tuple[Scene, ...]
    residual: tuple[Array, ...]
    columns: tuple[Array, ...]


def _base(model: Model, logs: Sequence[Log]) -> _Base:
    chosen, proposal = FitSettings(), ProposalSettings()
    mechanism = Mecanum(model.geometry, model.structure)
    samples = mechanism.samples_of(logs)
    found = fit(mechanism, samples, model.theta)
    rows = replace(chosen, row_rate=proposal.row_rate)
    basis = gauge_basis(mechanism, found.free) / mechanism.scale[found.free][:, None]
    of_logs = [regression(mechanism, found.theta, item, found.free, rows) for item in samples]
    settling = chosen.filter.settling_time_constants
    scenes = [
        Scene(mechanism, found.theta, item, row.step, settling, proposal)
        for item, row in zip(samples, of_logs, strict=True)
    ]
    return _Base(
        *(mechanism, found.theta, tuple(samples), tuple(scenes)),
        tuple(row.residual for row in of_logs),
        tuple(row.columns @ basis for row in of_logs),
    )


# --- sparse regression -------------------------------------------------------------------------


def sparse_regression(model: Model, logs: Sequence[Log]) -> Learned:
    """Terms of a library that explain what the base model leaves.

    The threshold is the largest that leaves hardly more of the last log, held out, than the best.

    Raises
    ------
    InputError
        If pysindy is not installed.
    """
    base = _base(model, logs)
    parts = [_rows_of(base, k) for k in range(len(logs))]
    known, held = parts[:-1] or parts, parts[-1]
    left = {t: _left(_sparse(known, t), held) for t in THRESHOLDS}
    # The sparsest that leaves hardly more than the best: a library's terms imitate each other.
    best = max(t for t in THRESHOLDS if left[t] <= ALIKE * min(left.values()))
    weights = _sparse(parts, best)
    own = float((_without(held.base, held.target) ** 2).sum())
    if 1.0 - left[best] / own < LEAST_SHARE:
        weights = np.zeros_like(weights)
    effects, law = _told(weights, parts)
    verdict = "unknown" if law else "effect" if effects else "adequate"
    return Learned(verdict, lambda motion: _sparse_torques(base, parts, weights, motion),
                   effects, law)  # fmt: skip


@dataclass(frozen=True)
class _Rows:
    """Rows of one log: target (M,), columns of the base model (M, F) and of the library (M, Q)."""

    target: Array
    base: Array
    library: Array


def _rows_of(base: _Base, k: int) -> _Rows:
    scene = base.scenes[k]
    forces = _library(base.mechanism, scene)
    rows = scene.rows(forces * base.mechanism.force_scale[:, None])
    n = min(len(rows), len(base.residual[k]))
    return _Rows(
        base.residual[k][:n].ravel(),
        base.columns[k][:n].reshape(-1, base.columns[k].shape[-1]),
        rows[:n].reshape(-1, rows.shape[-1]),
    )


def _joined(parts: Sequence[_Rows]) -> _Rows:
    names = ("target", "base", "library")
    return _Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _without(base: Array, values: Array) -> Array:
    """Values less what the base model's columns take of them."""
    return values - base @ np.linalg.lstsq(base, values, rcond=None)[0]


def _sparse(parts: Sequence[_Rows], threshold: float) -> Array:
    """(Q,) weights of the library, most of them zero."""
    STLSQ = optional_library("pysindy.optimizers", "sindy", "sparse regression").STLSQ
    rows = _joined(parts)
    target, library = _without(rows.base, rows.target), _without(rows.base, rows.library)
    scale = np.maximum(np.sqrt((library**2).mean(axis=0)), 1e-12)
    size = max(float(np.sqrt((target**2).mean())), 1e-300)
    found = STLSQ(threshold=threshold, alpha=1e-3, max_iter=20)
    with warnings.catch_warnings():
        # That nothing passes a threshold is an answer, which pysindy warns of.
        warnings.filterwarnings("ignore", "Sparsity parameter is too big", UserWarning)
        found.fit(library / scale, (target / size)[:, None])
    return np.asarray(found.coef_, float).ravel() * size / scale


def _left(weights: Array, held: _Rows) -> float:
    """Squares that weights leave of a held-out log, to whose base model everything is fitted."""
    return float((_without(held.base, held.target - held.library @ weights) ** 2).sum())


def _told(weights: Array, parts: Sequence[_Rows]) -> tuple[tuple[str, ...], dict[str, Any] | None]:
    """Names of the terms that matter, and the first of those without."""
    rows = _joined(parts)
    target, library = _without(rows.base, rows.target), _without(rows.base, rows.library)
    squares: dict[Term, Array] = defaultdict(lambda: np.zeros(len(target)))
    for term, weight, column in zip(TERMS, weights, library.T, strict=True):
        squares[term] += weight * column
    total = float((target**2).sum())
    shares = {term: float((part**2).sum()) / total for term, part in squares.items()}
    told = [t for t in sorted(shares, key=lambda t: -shares[t]) if shares[t] >= LEAST_SHARE]
    named = tuple(dict.fromkeys(term.effect for term in told if term.effect))
    nameless = next((term for term in told if not term.effect), None)
    law = nameless and {"site": nameless.site, "variables": [nameless.variable]}
    return named, law


def _at_each_sample(mechanism: Mechanism[Any], theta: Array, samples: Samples) -> Scene:
    """A log with a row at each of its samples."""
    settings = replace(ProposalSettings(), node_step=samples.dt)
    return Scene(mechanism, theta, samples, samples.dt, 0.0, settings)


def _sparse_torques(base: _Base, parts: Sequence[_Rows], weights: Array, motion: Log) -> Array:
    mechanism, rows = base.mechanism, _joined(parts)
    (samples,) = mechanism.samples_of([motion])
    scene = _at_each_sample(mechanism, base.theta, samples)
    more = np.einsum("naq,q->na", _library(mechanism, scene), weights)
    # The base model as it is beside the library.
    step = np.linalg.lstsq(rows.base, rows.target - rows.library @ weights, rcond=None)[0]
    free = fit(mechanism, base.samples, base.theta).free
    basis = gauge_basis(mechanism, free) / mechanism.scale[free][:, None]
    theta = base.theta.copy()
    theta[free] += basis @ step
    return _torques(mechanism, theta, samples, more)


def _torques(mechanism: Mechanism[Any], theta: Array, samples: Samples, more: Array) -> Array:
    """(N, 4) torques of the model's force and another (N, 3) [N, N, N m]."""
    starts, ends = mechanism.demand(theta, samples).force
    force = np.concatenate([starts[:1], 0.5 * (starts[1:] + ends[:-1]), ends[-1:]])
    return (force / mechanism.force_scale + more) @ np.linalg.pinv(mechanism.jacobian)


def _library(mechanism: Mechanism[Any], scene: Scene) -> Array:
    """(N, 3, Q) generalised forces of all terms at unit weight."""
    twist, pose, wheel = scene.twist, scene.pose, scene.wheel_speed
    signs = np.tanh(twist / np.array([WIDTHS[0], WIDTHS[0], WIDTHS[1]]))
    a, b, c = twist.T
    body = [*signs.T, *(twist * np.abs(twist)).T, a * b, a * c, b * c, a, b, c]
    psi = pose[:, 2]
    cos, sin = np.cos(psi), np.sin(psi)
    ones, world = np.ones_like(psi), np.column_stack([cos * a - sin * b, sin * a + cos * b])
    room = [ones, pose[:, 0], pose[:, 1], psi, cos, sin, np.cos(2 * psi), np.sin(2 * psi)]
    room += [scene.time, *np.tanh(world / WIDTHS[0]).T]
    found = [_on_axis(value, axis) for axis in range(3) for value in body]
    found += [_along_world(value, axis, cos, sin) for axis in range(3) for value in room]
    dry, torque = np.tanh(wheel / WIDTHS[2]), scene.torque
    slope = np.gradient(torque, scene.time, axis=0)
    jacobian = mechanism.jacobian
    for values in (dry, wheel * np.abs(wheel), slope):
        found.append(values @ jacobian)
    for values in (dry, wheel, np.ones_like(wheel), torque, np.maximum(dry, 0.0)):
        found += [values[:, [i]] * jacobian[[i]] for i in range(wheel.shape[1])]
    return np.stack(found, axis=-1)


def _on_axis(value: Array, axis: int) -> Array:
    out = np.zeros((len(value), 3))
    out[:, axis] = value
    return out


def _along_world(value: Array, axis: int, cos: Array, sin: Array) -> Array:
    if axis == 2:
        return _on_axis(value, 2)
    # A force along world X or Y, seen from the body.
    parts = (cos, -sin) if axis == 0 else (sin, cos)
    return np.column_stack([value * parts[0], value * parts[1], np.zeros_like(value)])


def _terms() -> list[Term]:
    found = []
    for axis in range(3):
        for k in range(12):
            scrub = axis == 2 and k == 2
            found.append(Term("yaw_scrub" if scrub else "", "body", "twist"))
    words = ("floor_tilt", "position_x", "position_y", "heading", *("heading",) * 4)
    for axis in range(3):
        for k, word in enumerate((*words, "time", "heading", "heading")):
            effect = word if k == 0 and axis < 2 else "cable_twist" if (axis, k) == (2, 3) else ""
            found.append(Term(effect, "world", "twist" if k == 0 else word))
    for name in ("wheel_coulomb_friction", "quadratic_friction", "actuator_lag"):
        found.append(Term(name, "wheel", "wheel_speed"))
    uneven = ("uneven_coulomb_friction", "uneven_wheel_friction", "torque_offset",
              "torque_gain_error", "")  # fmt: skip
    found += [Term(name, "wheel", "wheel_speed") for name in uneven for _ in range(4)]
    return found


TERMS = _terms()
"""Of the library's columns, in their order."""


# --- trees -------------------------------------------------------------------------------------


def boosted_residual(model: Model, logs: Sequence[Log], seed: int) -> Learned:
    """Gradient-boosted trees of what the base model leaves, from what the motion shows."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    base = _base(model, logs)
    features = [_features(scene) for scene in base.scenes]
    shown = [scene.rows(part[:, None, :])[:, 0] for scene, part in
             zip(base.scenes, features, strict=True)]  # fmt: skip
    counts = [min(len(x), len(r)) for x, r in zip(shown, base.residual, strict=True)]
    given = [x[:n] for x, n in zip(shown, counts, strict=True)]
    wanted = [r[:n] for r, n in zip(base.residual, counts, strict=True)]

    def fitted(which: slice) -> list[Any]:
        x, y = np.concatenate(given[which]), np.concatenate(wanted[which])
        return [
            HistGradientBoostingRegressor(random_state=seed, max_iter=200)
            .fit(x, y[:, axis])
            for axis in range(y.shape[1])
        ]  # fmt: skip

    held = np.column_stack([tree.predict(given[-1]) for tree in fitted(slice(None, -1))])
    own = float((wanted[-1] ** 2).sum())
    helps = 1.0 - float(((wanted[-1] - held) ** 2).sum()) / own >= LEAST_SHARE
    trees = fitted(slice(None)) if helps else []

    def torques(motion: Log) -> Array:
        (samples,) = base.mechanism.samples_of([motion])
        scene = _at_each_sample(base.mechanism, base.theta, samples)
        more = np.zeros((len(samples.time), 3))
        if trees:
            x = _features(scene)
            force = np.column_stack([tree.predict(x) for tree in trees])
            more[-len(force) :] = force / base.mechanism.force_scale
        return _torques(base.mechanism, base.theta, samples, more)

    return Learned("unknown" if helps else "adequate", torques)


def _features(scene: Scene) -> Array:
    """(N, Q) what trees may read: speeds, their signs, heading, place, angles, time."""
    psi = scene.pose[:, 2]
    return np.column_stack([
        scene.twist, scene.wheel_speed, np.tanh(scene.wheel_speed / WIDTHS[2]),
        np.cos(psi), np.sin(psi), scene.pose, np.cos(scene.angle), np.sin(scene.angle), scene.time,
    ])  # fmt: skip
