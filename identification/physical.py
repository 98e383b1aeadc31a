"""From fitted theta to the paper's physical parameters, with the covariance carried along."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mecanum import Mecanum
from identification.regression import Fit
from youbot_env.effects import CATALOGUE
from youbot_env.errors import InputError
from youbot_env.model import BASE_UNITS, Estimate, Model

Array = NDArray[np.float64]


def settle_gauge(mechanism: Mecanum, theta: Array) -> tuple[Array, Array]:
    """Give what only differences show its stated zero: the least wheel, or the wheels' mean.

    Returns the new theta (P,) and the (P, P) map that it came by, for the covariance. The common
    part that is taken away goes to the base parameter that means the same.
    """
    names = list(mechanism.parameter_names)
    change = np.eye(len(names))
    for group in dict.fromkeys(label.group for label in mechanism.labels if label.group):
        members = [k for k, label in enumerate(mechanism.labels) if label.group == group]
        parameter = mechanism.labels[members[0]].parameter
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


def physical_names(mechanism: Mecanum) -> tuple[str, ...]:
    """Names of the fitted parameters in physical form: m0 ... mu2, then ``effect.parameter``."""
    rename = {"m_aX": "aX", "m_aY": "aY"}
    names = [mechanism.parameter_names[k] for k in np.flatnonzero(mechanism.free)]
    return tuple(rename.get(name, name) for name in names)


def physical_covariance(mechanism: Mecanum, fit: Fit) -> Array:
    """(F, F) covariance of ``physical_names``, first order."""
    theta, change = settle_gauge(mechanism, fit.theta)
    to_physical = np.eye(len(theta))
    names = list(mechanism.parameter_names)
    mass = theta[names.index("m0")] - 4 * mechanism.geometry.m1
    for name in ("m_aX", "m_aY"):
        row = names.index(name)
        to_physical[row, row] = 1.0 / mass
        to_physical[row, names.index("m0")] = -theta[row] / mass**2
    total = (to_physical @ change)[np.ix_(fit.free, fit.free)]
    return total @ fit.covariance @ total.T


def fitted_model(
    mechanism: Mecanum,
    fit: Fit,
    *,
    name: str = "model",
    logs: tuple[Mapping[str, str], ...] = (),
    errors: Mapping[str, Any] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Model:
    """The model that a fit stands for.

    Raises
    ------
    InputError
        If the fit is not physical (a negative mass, say): the logs do not show the parameters.
    """
    theta, _ = settle_gauge(mechanism, fit.theta)
    covariance = physical_covariance(mechanism, fit)
    names = physical_names(mechanism)
    std = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
    values = dict(zip(mechanism.parameter_names, map(float, theta), strict=True))
    mass = values["m0"] - 4 * mechanism.geometry.m1
    if mass <= 0:
        raise InputError(
            f"the fitted mass m0 = {values['m0']:.3g} kg is below that of the four wheels "
            f"({4 * mechanism.geometry.m1:.3g} kg): the logs do not show it; record motions "
            "I and II, or check the torques' unit and the geometry"
        )
    values |= {"aX": values["m_aX"] / mass, "aY": values["m_aY"] / mass}

    def entry(key: str, unit: str) -> Estimate:
        return Estimate(values[key], unit, float(std[key]) if key in std else None)

    effects = {
        effect: {
            key: entry(f"{effect}.{key}", CATALOGUE[effect].parameter(key).unit)
            for key in CATALOGUE[effect].parameter_names
        }
        for effect in mechanism.structure.effects
    }
    return Model(
        geometry=mechanism.geometry,
        parameters={key: entry(key, unit) for key, unit in BASE_UNITS.items()},
        effects=effects,
        covariance=covariance,
        covariance_names=names,
        logs=logs,
        errors=errors or {},
        name=name,
        provenance=provenance or {},
    )
