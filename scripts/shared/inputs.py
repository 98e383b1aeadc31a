"""Reading of a model and logs, for the commands that take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification.logs.log import Log
    from identification.mechanisms.registry import AnyModel
    from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True)
class Inputs:
    """A model and logs of its mechanism; geometry: what replaces the model's own, or None."""

    model: AnyModel
    logs: list[Log]
    geometry: Geometry | None = None


def read_inputs(
    model: str,
    logs: Sequence[Path],
    *,
    effects: Path | None = None,
    mechanism: str | None = None,
    geometry: str | None = None,
) -> Inputs:
    """Read what the options of a command name.

    Parameters
    ----------
    effects : Python file that registers a user's own effects; it is run
    mechanism : that the model must be of; None for any
    geometry : file of another platform's lengths

    Raises
    ------
    InputError
        If a file cannot be used, or the model is of another mechanism.
    """
    from identification.logs.reading import read_logs
    from identification.mechanisms.registry import (
        check_mechanism,
        kind_of,
        load_any_model,
        platform_geometry,
    )
    from youbot_env.model.model_file import load_geometry

    if effects:
        from youbot_env.plugins import load_effects

        load_effects(effects)  # before the model is read, since its file may name these effects
    loaded = load_any_model(model)
    check_mechanism(loaded, mechanism)
    lengths = load_geometry(geometry) if geometry else None
    own = platform_geometry(loaded)
    return Inputs(loaded, read_logs(logs, kind_of(loaded).joints, geometry=lengths or own), lengths)


def read_logs_to_fit(
    logs: Sequence[Path], model: str | None, geometry: str | None, mechanism: str, unit: str
) -> Inputs:
    """Read logs, and the model whose structure is fitted to them.

    Parameters
    ----------
    model : file; None for the base model of the ``mechanism``
    unit : of an axis' position, "rad" or "m"

    Raises
    ------
    InputError
        If a file cannot be used, or there is no such mechanism.
    """
    from identification.logs.reading import read_logs
    from identification.mechanisms.registry import (
        kind,
        kind_of,
        load_any_model,
        platform_geometry,
    )
    from youbot_env.model.model_file import load_geometry

    start = load_any_model(model) if model else None
    lengths = load_geometry(geometry) if geometry else None
    of = kind_of(start) if start else kind(mechanism)
    own = platform_geometry(start) if start else None
    read = read_logs(logs, of.joints, geometry=lengths or own)
    return Inputs(start or of.start(read, unit), read, lengths)
