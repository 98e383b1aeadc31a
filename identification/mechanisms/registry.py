"""Which mechanisms there are: the one place that knows them by name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from identification.logs.log import Log
from identification.mechanisms.mecanum import CONVENTIONS
from identification.mechanisms.mechanism import Conventions, FitResult, Mechanism
from identification.mechanisms.physical_parameters import fitted_model
from identification.mechanisms.plausibility import barely_observable, warnings_of
from identification.mechanisms.quantities import Quantities
from identification.mechanisms.settings import MechanismSettings
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import (
    load_model,
    model_from_dict,
    read_content,
    save_model,
)
from youbot_env.physics.geometry import Geometry

AnyModel = Model[Any]
"""A model of any mechanism."""


def _no_file(*_: object) -> Any:
    raise InputError("models of this mechanism have no file")


@dataclass(frozen=True)
class Entry:
    """One kind of mechanism that can be identified, and its model files.

    conventions : how it is identified
    start(logs, unit) : base model to fit
    whole(logs, unit) : the same with every base parameter, also those that no such log could show;
        None where ``start`` has them all
    read(data, source), save(path, model) : its model files
    warnings(model, settings) : plain sentences on what is implausible or barely observable
    takes_geometry : whether a geometry can be given for it (``--geometry``)
    """

    conventions: Conventions[Any]
    start: Callable[[Sequence[Log], str], AnyModel]
    whole: Callable[[Sequence[Log], str], AnyModel] | None = None
    read: Callable[[Mapping[str, Any], str], AnyModel] = _no_file
    save: Callable[[str | os.PathLike[str], AnyModel], None] = _no_file
    warnings: Callable[[AnyModel, MechanismSettings], list[str]] = barely_observable
    takes_geometry: bool = False

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in its logs."""
        return self.conventions.kind.joints

    def fitted_model(self, mechanism: Mechanism[Any], fit: FitResult, **about: Any) -> AnyModel:
        """The model that a fit stands for; about: name, logs, errors, provenance."""
        return fitted_model(mechanism, fit, **about)


def _mecanum() -> Entry:
    return Entry(
        CONVENTIONS,
        lambda logs, unit: load_model("paper"),
        read=model_from_dict,
        save=save_model,
        warnings=warnings_of,
        takes_geometry=True,
    )


@cache
def _axis() -> Entry:
    # Imported when one is met: most users have a platform, and starting is part of every command.
    from identification.mechanisms import axis_model
    from identification.mechanisms.axis import CONVENTIONS as OF_AXIS

    return Entry(
        OF_AXIS,
        lambda logs, unit: axis_model.base_axis_model(logs, unit=unit),
        lambda logs, unit: axis_model.base_axis_model(logs, unit=unit, every=True),
        axis_model.axis_from_dict,
        axis_model.save_axis_model,
        axis_model.warnings_of,
    )


MECHANISMS: dict[str, Callable[[], Entry]] = {"mecanum": cache(_mecanum), "axis": _axis}
"""Kinds of mechanism by the name that model files and ``--mechanism`` give them.

To identify another, put it here under its name."""


def kind(name: str) -> Entry:
    """A kind of mechanism by name.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name not in MECHANISMS:
        raise InputError(f"unknown mechanism {name!r}; known are {', '.join(MECHANISMS)}")
    return MECHANISMS[name]()


def kind_of(model: AnyModel) -> Entry:
    """The kind of mechanism that a model is of."""
    return kind(model.mechanism.name)


def check_mechanism(model: AnyModel, name: str | None) -> None:
    """Refuse a model that is not of the mechanism a user has named.

    Raises
    ------
    InputError
        If the name is unknown or another than the model's.
    """
    if name is not None and kind(name) is not kind_of(model):
        raise InputError(f"model {model.name} is not of mechanism {name!r}; leave --mechanism out")


def mechanism_of(
    model: AnyModel,
    geometry: Geometry | None = None,
    settings: MechanismSettings = MechanismSettings(),
) -> Mechanism[Any]:
    """The mechanism that a model is of; ``geometry`` replaces a platform's own.

    Parameters
    ----------
    settings : numbers that its samples, parts and demanded force depend on

    Raises
    ------
    InputError
        If a geometry is given for a mechanism that has none.
    """
    of = kind_of(model)
    acts_in = {name: frozenset(logs) for name, logs in model.effect_logs.items()}
    known = _known(model, geometry)
    if geometry is not None:
        # Of other rollers it is of another kind: the model says which.
        model = replace(model, geometry=known, covariance=None, covariance_names=())
    return Mechanism(known, model.structure, of.conventions, settings, acts_in=acts_in)


def quantities_of(model: AnyModel, geometry: Geometry | None = None) -> Quantities:
    """Symbols and units of what is measured of a model's mechanism."""
    return kind_of(model).conventions.quantities(_known(model, geometry))


def _known(model: AnyModel, geometry: Geometry | None) -> Any:
    if geometry is None:
        return model.geometry
    if not kind_of(model).takes_geometry:
        raise InputError("--geometry is of a mecanum platform; the axis of this model has none")
    return geometry


def platform_geometry(model: AnyModel) -> Geometry | None:
    """Lengths that a log's wheels can be checked with, if the model's mechanism has wheels."""
    return model.geometry if kind_of(model).takes_geometry else None


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
