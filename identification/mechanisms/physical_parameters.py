"""From fitted theta to parameters as people state them, with the covariance carried along."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import FitResult, Mechanism
from youbot_env.model.model import Estimate, Model
from youbot_env.physics.stated_parameters import jacobian, public_parameters, to_public

Array = NDArray[np.float64]


def settle_gauge(mechanism: Mechanism[Any], theta: Array) -> tuple[Array, Array]:
    """Give what only differences show its stated zero: the least wheel, or the wheels' mean.

    Of offsets of the torques that is none along those that exert no force.

    Returns the new theta (P,) and the (P, P) map that it came by, for the covariance. The common
    part that is taken away goes to the base parameter that means the same.
    """
    names = list(mechanism.parameter_names)
    change = np.eye(len(names))
    for group in dict.fromkeys(label.group for label in mechanism.labels if label.group):
        members = [k for k, label in enumerate(mechanism.labels) if label.group == group]
        parameter = mechanism.labels[members[0]].parameter
        if parameter.relative_to == "internal":
            unseen = np.array(mechanism.internal) / np.linalg.norm(mechanism.internal)
            step = np.eye(len(names))
            step[np.ix_(members, members)] -= np.outer(unseen, unseen)
            change, theta = step @ change, step @ theta
            continue
        weight = np.zeros(len(names))
        if parameter.relative_to == "least":
            weight[members[int(np.argmin(theta[members]))]] = 1.0
        else:
            weight[members] = 1.0 / len(members)
        step = np.eye(len(names))
        step[members] -= weight
        if parameter.absorbed_by:
            step[names.index(parameter.absorbed_by)] += weight
        change = step @ change
        theta = step @ theta
    return theta, change


def physical_covariance(mechanism: Mechanism[Any], fit: FitResult) -> tuple[tuple[str, ...], Array]:
    """Names (F,) of the fitted parameters as people state them, and their covariance (F, F).

    First order. What the fit leaves without any place (the anchor of a tether that does not pull)
    is left out.
    """
    structure = mechanism.structure
    theta, change = settle_gauge(mechanism, fit.theta)
    slope = (jacobian(structure, mechanism.geometry, theta) @ change)[:, fit.free]
    declared = public_parameters(structure, mechanism.geometry)
    kept = [k for k, row in enumerate(slope) if row.any()]
    names = list(declared)
    return tuple(names[k] for k in kept), slope[kept] @ fit.covariance @ slope[kept].T


def limits(mechanism: Mechanism[Any], theta: Array) -> dict[str, float]:
    """How far parameters theta (P,) are within what a model may hold, by the parameter's full name.

    Negative beyond; in units of the parameters' sizes. Bounds are those of the parameters as people
    state them, so the gauge is settled first; beside them, what the base parameters must be
    together (:class:`~identification.mechanisms.mechanism.Conventions`).
    """
    geometry, settled = mechanism.geometry, settle_gauge(mechanism, theta)[0]
    declared = public_parameters(mechanism.structure, geometry)
    found = {}
    for name, value in to_public(mechanism.structure, geometry, settled).items():
        known = declared[name]
        room = min(value - known.lower, known.upper - value)
        if np.isfinite(room) or not np.isfinite(value):
            found[name] = room / known.size if np.isfinite(value) else -1.0
    together = mechanism.conventions.limits(geometry, settled, mechanism.settings)
    return {**found, **together}


def well_inside(mechanism: Mechanism[Any], theta: Array) -> Array:
    """(P,) parameters within all limits: the base near theta, shapes too, effects without strength.

    They are where a search for the best parameters within the limits can always begin.
    """
    base = len(mechanism.structure.base_names)
    lower, upper = mechanism.bounds
    shapes = np.array([label.parameter.is_shape for label in mechanism.labels])
    none = np.array([label.parameter.without for label in mechanism.labels])
    strength = np.where(shapes | (np.arange(len(theta)) < base), theta, none)
    found = np.clip(np.where(np.isfinite(strength), strength, 0.0), lower, upper)
    found[:base] = mechanism.conventions.inside(
        mechanism.geometry, found[:base], mechanism.settings
    )
    return found


def public_values(mechanism: Mechanism[Any], theta: Array) -> dict[str, float]:
    """The parameters at ``theta`` (P,) by the names and in the units that a model file has."""
    settled, _ = settle_gauge(mechanism, theta)
    return dict(to_public(mechanism.structure, mechanism.geometry, settled))


@dataclass(frozen=True)
class StatedParameters:
    """Parameters of a fit as people state them, in SI units; a model holds these and more.

    parameters : of the base, by name
    effects : by an effect's name its parameters, by theirs
    errors : of the fit, see :class:`~youbot_env.model.model.Model`
    """

    parameters: Mapping[str, Estimate]
    effects: Mapping[str, Mapping[str, Estimate]]
    errors: Mapping[str, Any]


def stated_parameters(
    mechanism: Mechanism[Any], fit: FitResult, errors: Mapping[str, Any] | None = None
) -> StatedParameters:
    """Values and standard deviations (None of what was not fitted) of a fit."""
    mechanism = mechanism.plainly_named()
    theta, _ = settle_gauge(mechanism, fit.theta)
    names, covariance = physical_covariance(mechanism, fit)
    std = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
    declared = public_parameters(mechanism.structure, mechanism.geometry)
    values = to_public(mechanism.structure, mechanism.geometry, theta)

    def entry(key: str) -> Estimate:
        return Estimate(values[key], declared[key].unit, float(std[key]) if key in std else None)

    effects: dict[str, dict[str, Estimate]] = {name: {} for name in mechanism.structure.effects}
    for key in declared:
        effect, dot, parameter = key.partition(".")
        if dot:
            effects[effect][parameter] = entry(key)
    base = {key: entry(key) for key in mechanism.kind.base_parameters(mechanism.geometry)}
    return StatedParameters(base, effects, errors or {})


def fitted_model(
    mechanism: Mechanism[Any],
    fit: FitResult,
    *,
    name: str = "model",
    logs: tuple[Mapping[str, str], ...] = (),
    errors: Mapping[str, Any] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Model[Any]:
    """The model that a fit stands for, which is within :func:`limits`.

    Raises
    ------
    InputError
        If it is not: nothing has that mass, say.
    """
    stated = stated_parameters(mechanism, fit, errors)
    mechanism = mechanism.plainly_named()
    names, covariance = physical_covariance(mechanism, fit)
    return Model(
        geometry=mechanism.geometry,
        parameters=stated.parameters,
        effects=stated.effects,
        effect_logs={key: tuple(sorted(logs)) for key, logs in mechanism.acts_in.items()},
        covariance=covariance,
        covariance_names=names,
        logs=logs,
        errors=stated.errors,
        name=name,
        provenance=provenance or {},
        mechanism=mechanism.kind,
    )
