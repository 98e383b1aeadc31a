"""A model of one axis: parameters with uncertainty, effects, and its file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.axis import Axis
from identification.mechanisms.axis_dynamics import AxisStructure
from identification.mechanisms.axis_effects import AXIS_BASE, AXIS_CATALOGUE, Scales, fitted_to
from identification.mechanisms.axis_samples import typical
from identification.mechanisms.mechanism import FitResult
from identification.signals.filters import FilterSettings
from youbot_env.errors import InputError
from youbot_env.files import SCHEMA_VERSION, FileKind, write_json
from youbot_env.model import model_file as parts
from youbot_env.model.covariance import check_covariance
from youbot_env.model.model import Estimate
from youbot_env.physics.effect import Effect

Array = NDArray[np.float64]

MECHANISM = "axis"
BASE_NAMES = tuple(name for item in AXIS_BASE for name in item.parameter_names)
UNITS = ("m", "rad")
"""Units of the position: of an axis that slides, and of one that turns."""

BARELY = 0.2
"""A standard deviation above this share of the value is called barely observable."""


@dataclass(frozen=True)
class AxisModel:
    """Dynamic model of one axis. Immutable.

    Attributes
    ----------
    scales : units and typical sizes of the axis
    parameters : inertia, viscous, coulomb, smoothing, offset
    effects : for each added effect its parameters by name
    covariance : (k, k) of the parameters named in ``covariance_names``, or None
    logs : name and sha256 of each log that it was fitted on
    errors, provenance : as of :class:`youbot_env.model.model.Model`

    Raises
    ------
    InputError
        If a parameter is missing, not finite or outside its physical bounds.
    """

    scales: Scales
    parameters: Mapping[str, Estimate]
    effects: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    covariance: Array | None = None
    covariance_names: tuple[str, ...] = ()
    logs: tuple[Mapping[str, str], ...] = ()
    errors: Mapping[str, Any] = field(default_factory=dict)
    name: str = "model"
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, label in zip(self.structure.parameter_names, self.axis.labels, strict=True):
            if name not in self.values:
                raise InputError(f"model {self.name}: parameter {name!r} is missing")
            if fault := label.parameter.fault(self.values[name]):
                raise InputError(f"model {self.name}: {name} = {fault}")
        if self.values["inertia"] <= 0:
            raise InputError(f"model {self.name}: inertia must be positive")
        where = f"model {self.name}: covariance"
        check_covariance(self.covariance, self.covariance_names, self.values, where)

    @cached_property
    def structure(self) -> AxisStructure:
        """Which effects it holds, and so the order of ``theta``."""
        return AxisStructure(tuple(self.effects))

    @cached_property
    def axis(self) -> Axis:
        """The mechanism that it is a model of."""
        return Axis(self.scales, self.structure)

    @cached_property
    def values(self) -> dict[str, float]:
        """All parameters by full name, those of effects as ``effect.parameter``."""
        found = {name: float(item.value) for name, item in self.parameters.items()}
        for effect, parameters in self.effects.items():
            found |= {f"{effect}.{name}": float(item.value) for name, item in parameters.items()}
        return found

    @cached_property
    def theta(self) -> Array:
        """(P,) parameters in the order of ``structure.parameter_names``."""
        return np.array([self.values[name] for name in self.structure.parameter_names])


def axis_model(axis: Axis, theta: Array, std: Mapping[str, float] | None = None) -> AxisModel:
    """The model of an axis with parameters theta (P,); std by full name, where it is known."""
    found = {
        name: Estimate(float(value), label.parameter.unit, (std or {}).get(name))
        for name, value, label in zip(axis.parameter_names, theta, axis.labels, strict=True)
    }
    effects = {
        effect: {name: found[f"{effect}.{name}"] for name in axis.catalogue[effect].parameter_names}
        for effect in axis.structure.effects
    }
    return AxisModel(axis.scales, {name: found[name] for name in BASE_NAMES}, effects)


def base_axis_model(logs: Sequence[Log], *, unit: str = "rad") -> AxisModel:
    """Where the identification of an unknown axis starts: typical inertia and nothing else.

    Raises
    ------
    InputError
        If ``unit`` (of the position) is neither "m" nor "rad", or nothing moves in the logs.
    """
    if unit not in UNITS:
        raise InputError(f"unit {unit!r}: an axis is logged in m (m/s, N) or rad (rad/s, N m)")
    axis = Axis(typical(logs, turns=unit == "rad"))
    return axis_model(axis, axis.default_theta)


def fitted_axis_model(axis: Axis, fit: FitResult, **about: Any) -> AxisModel:
    """The model that a fit stands for; about: name, logs, errors, provenance.

    Raises
    ------
    InputError
        If the fit is not physical (no inertia, say): the logs do not show the parameters.
    """
    names = tuple(axis.parameter_names[k] for k in fit.free)
    std = {name: float(value) for name, value in zip(names, fit.std, strict=True)}
    known = {key: value for key, value in about.items() if value is not None}
    model = axis_model(axis, fit.theta, std)
    return replace(model, covariance=fit.covariance, covariance_names=names, **known)


def warnings_of(model: AxisModel) -> list[str]:
    """Plain sentences on what the logs barely show; an offset may well be zero."""
    entries = [(name, entry) for name, entry in model.parameters.items() if name != "offset"]
    for effect, parameters in model.effects.items():
        entries += [(f"{effect}.{name}", entry) for name, entry in parameters.items()]
    return [
        f"{name} = {entry.value:.3g} +- {entry.std:.2g} {entry.unit} is barely observable "
        "in these logs"
        for name, entry in entries
        if entry.std is not None and entry.std > BARELY * abs(entry.value)
    ]


def save_axis_model(path: str | os.PathLike[str], model: AxisModel) -> None:
    """Write a model file: complete or not at all."""
    write_json(path, axis_to_dict(model))


def axis_to_dict(model: AxisModel) -> dict[str, Any]:
    """The model file's content."""
    sizes = {key: value for key, value in asdict(model.scales).items() if key != "turns"}
    return {
        "schema_version": SCHEMA_VERSION,
        "name": model.name,
        "mechanism": MECHANISM,
        "scales": {"unit": UNITS[model.scales.turns], **sizes},
        "parameters": {name: parts.estimate_entry(model.parameters[name]) for name in BASE_NAMES},
        "effects": parts.effect_entries(model.effects),
        **parts.history_to_dict(model),
    }


def axis_from_dict(data: Mapping[str, Any], source: str) -> AxisModel:
    """Build and check a model from a model file's content; ``source`` names it in errors.

    A file written by hand may leave out ``scales``: they are then guessed from the parameters.
    """
    return AXIS_FILE.from_content(data, source)


def _axis_model(content: dict[str, Any], source: str) -> AxisModel:
    given = content["parameters"]
    scales = _scales(content["scales"]) if content.get("scales") else _guessed(given)
    return AxisModel(
        scales,
        _estimates(AXIS_BASE, scales, given, "parameters"),
        {
            name: _estimates(
                (AXIS_CATALOGUE[name],),
                scales,
                entry.get("parameters", {}),
                f"effects.{name}.parameters",
            )
            for name, entry in content.get("effects", {}).items()
        },
        **parts.history_from_dict(content),
    )


def _estimates(
    items: Iterable[Effect], scales: Scales, given: Mapping[str, Any], where: str
) -> dict[str, Estimate]:
    """Estimates of effects; shape constants that are left out take their defaults."""
    known = [p for item in items for p in fitted_to(item, scales).parameters]
    shapes = {p.name: p.default for p in known if p.is_shape}
    return parts.estimates({**shapes, **given}, {p.name: p.unit for p in known}, where)


def _scales(entries: Mapping[str, Any]) -> Scales:
    sizes = [parts.number(entries[key], f"scales.{key}") for key in SIZES]
    if min(sizes) <= 0:
        raise InputError("scales must be positive")
    band = parts.number(entries.get("bandwidth", FilterSettings.rate), "scales.bandwidth")
    return Scales(entries["unit"] == "rad", *sizes, bandwidth=band)


def _guessed(parameters: Mapping[str, Any]) -> Scales:
    """Scales that a model's own parameters suggest: viscous friction as large as dry friction."""
    names = ("inertia", "viscous", "coulomb")
    for name in names:
        if name not in parameters:
            raise InputError(f"parameters: {name!r} is missing")
    inertia, viscous, coulomb = (parts.number(parameters[n], f"parameters.{n}") for n in names)
    entry = parameters["inertia"]
    turns = not isinstance(entry, Mapping) or entry.get("unit", "kg m^2") == "kg m^2"
    speed = coulomb / viscous if min(inertia, viscous, coulomb) > 0 else 1.0
    force = 2 * coulomb or inertia
    return Scales(turns, speed, abs(force / (inertia or 1.0)), abs(force), speed)


SIZES = ("speed", "acceleration", "force", "travel")
"""Of the scales; a file must give all, in any case."""

AXIS_FILE = FileKind(
    "a model file",
    {
        "type": "object",
        "properties": {
            "scales": {
                "type": ["object", "null"],
                "properties": {
                    "unit": {"enum": list(UNITS)},
                    **dict.fromkeys((*SIZES, "bandwidth"), parts.ENTRY),
                },
                "required": ["unit", *SIZES],
            },
            **parts.SHARED,
        },
        "required": ["parameters"],
    },
    _axis_model,
)
