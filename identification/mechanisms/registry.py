"""Which mechanisms there are: the one place that knows them by name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from identification.logs.log import AXIS, Log
from identification.mechanisms import plausibility
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import fitted_model
from identification.mechanisms.quantities import Quantities, of_axis, of_platform
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import (
    load_model,
    model_from_dict,
    read_content,
    save_model,
)
from youbot_env.physics.geometry import WHEELS, Geometry

if TYPE_CHECKING:
    from identification.mechanisms.axis_model import AxisModel

    AnyModel = Model | AxisModel
else:
    AnyModel = Any


@dataclass(frozen=True)
class MechanismKind:
    """One kind of mechanism: its model, what its logs hold, and how both become a mechanism.

    model: its class; joints: of its logs; build(model, geometry); start(logs, unit): base model
    to fit; read(data, source): from a model file's content; save(path, model);
    quantities(model, geometry): symbols and units of what is measured;
    fitted_model(mechanism, fit, **about): the model that a fit stands for; about: name, logs,
    errors, provenance; warnings(model): plain sentences on what is implausible or barely observable
    """

    model: type
    joints: tuple[str, ...]
    build: Callable[[Any, Geometry | None], Mechanism]
    start: Callable[[Sequence[Log], str], Any]
    read: Callable[[Mapping[str, Any], str], Any]
    save: Callable[[str | os.PathLike[str], Any], None]
    quantities: Callable[[Any, Geometry | None], Quantities]
    fitted_model: Callable[..., Any]
    warnings: Callable[[Any], list[str]]


def _mecanum() -> MechanismKind:
    return MechanismKind(
        Model,
        WHEELS,
        lambda model, geometry: Mecanum(geometry or model.geometry, model.structure),
        lambda logs, unit: load_model("paper"),
        model_from_dict,
        save_model,
        lambda model, geometry: of_platform(geometry or model.geometry),
        fitted_model,
        plausibility.warnings_of,
    )


@cache
def _axis() -> MechanismKind:
    # Imported when one is met: most users have a platform, and starting is part of every command.
    from identification.mechanisms.axis_model import (
        AxisModel,
        axis_from_dict,
        base_axis_model,
        fitted_axis_model,
        save_axis_model,
        warnings_of,
    )

    def build(model: Any, geometry: Geometry | None) -> Mechanism:
        if geometry is not None:
            raise InputError("--geometry is of a mecanum platform; the axis of this model has none")
        return model.axis

    return MechanismKind(
        AxisModel,
        AXIS,
        build,
        lambda logs, unit: base_axis_model(logs, unit=unit),
        axis_from_dict,
        save_axis_model,
        lambda model, geometry: of_axis(model),
        fitted_axis_model,
        warnings_of,
    )


MECHANISMS: dict[str, Callable[[], MechanismKind]] = {"mecanum": cache(_mecanum), "axis": _axis}
"""Kinds of mechanism by the name that model files and ``--mechanism`` give them."""


def kind(name: str) -> MechanismKind:
    """A kind of mechanism by name.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name not in MECHANISMS:
        raise InputError(f"unknown mechanism {name!r}; known are {', '.join(MECHANISMS)}")
    return MECHANISMS[name]()


def kind_of(model: AnyModel) -> MechanismKind:
    """The kind of mechanism that a model is of."""
    kinds = (make() for make in MECHANISMS.values())
    return next(item for item in kinds if isinstance(model, item.model))


def check_mechanism(model: AnyModel, name: str | None) -> None:
    """Refuse a model that is not of the mechanism a user has named.

    Raises
    ------
    InputError
        If the name is unknown or another than the model's.
    """
    if name is not None and kind(name) is not kind_of(model):
        raise InputError(f"model {model.name} is not of mechanism {name!r}; leave --mechanism out")


def mechanism_of(model: AnyModel, geometry: Geometry | None = None) -> Mechanism:
    """The mechanism that a model is of; ``geometry`` replaces a platform's own."""
    return kind_of(model).build(model, geometry)


def quantities_of(model: AnyModel, geometry: Geometry | None = None) -> Quantities:
    """Symbols and units of what is measured of a model's mechanism."""
    return kind_of(model).quantities(model, geometry)


def load_any_model(source: str | os.PathLike[str]) -> Any:
    """Load a model file of any mechanism, or a model that ships with the package by name.

    Raises
    ------
    InputError
        If the file cannot be read or does not hold a valid model: one line with file and key.
    """
    name = os.fspath(source)
    data = read_content(name)
    mechanism = data.get("mechanism", "mecanum")
    # A list, since what the file holds need not be hashable.
    if mechanism not in list(MECHANISMS):
        raise InputError(f"{name}: unknown mechanism {mechanism!r}; known: {', '.join(MECHANISMS)}")
    return MECHANISMS[mechanism]().read(data, name)


def save_any_model(path: str | os.PathLike[str], model: AnyModel) -> None:
    """Write a model file: complete or not at all."""
    kind_of(model).save(path, model)
