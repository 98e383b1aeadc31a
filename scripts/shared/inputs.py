"""Reading of a model and logs, for the commands that take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from identification.logs.log import Log
    from identification.logs.reading import SetAside
    from identification.mechanisms.registry import AnyModel
    from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True)
class Inputs:
    """A model and logs of its mechanism.

    geometry : what replaces the model's own, or None
    set_aside : logs that cannot be used, each with its reason
    """

    model: AnyModel
    logs: list[Log]
    geometry: Geometry | None = None
    set_aside: list[SetAside] = field(default_factory=list)

    def tell(self, out: Console) -> None:
        """Print a warning for each log that was set aside."""
        for item in self.set_aside:
            out.print(f"warning: {item}", style="yellow", soft_wrap=True)

    def tell_doubts(self, out: Console) -> None:
        """Print what is wrong with the logs, for a command whose result does not say it."""
        from identification.logs.log import warnings_of_logs

        for line in warnings_of_logs(self.logs):
            out.print(f"warning: {line}", style="yellow", soft_wrap=True)

    def to_dict(self) -> dict[str, list[dict[str, str]]]:
        """What a command's JSON holds of them."""
        return {"set_aside": [item.to_dict() for item in self.set_aside]}


def next_diagnosis(model: str, logs: Sequence[Path], most: int = 3) -> str:
    """The command that says what a model lacks on logs; of many logs the first are named."""
    named = [str(path) for path in logs[:most]] + ["..."] * (len(logs) > most)
    return " ".join(["youbot diagnose", model, *named])


def read_inputs(
    model: str,
    logs: Sequence[Path],
    *,
    mechanism: str | None = None,
    geometry: str | None = None,
    strict: bool = False,
) -> Inputs:
    """Read what the options of a command name.

    Parameters
    ----------
    mechanism : that the model must be of; None for any
    geometry : file of another platform's lengths
    strict : refuse all logs where one cannot be used

    Raises
    ------
    InputError
        If the model or all logs cannot be used, or the model is of another mechanism.
    """
    from identification.logs.reading import read_usable_logs
    from identification.mechanisms.registry import (
        check_mechanism,
        kind_of,
        load_any_model,
        platform_geometry,
    )
    from youbot_env.model.model_file import load_geometry

    loaded = load_any_model(model)
    check_mechanism(loaded, mechanism)
    lengths = load_geometry(geometry) if geometry else None
    own = platform_geometry(loaded)
    joints = kind_of(loaded).joints
    read, aside = read_usable_logs(logs, joints, strict=strict, geometry=lengths or own)
    return Inputs(loaded, read, lengths, aside)


def read_logs_to_fit(
    logs: Sequence[Path],
    model: str | None,
    geometry: str | None,
    mechanism: str,
    unit: str,
    strict: bool = False,
) -> Inputs:
    """Read logs, and the model whose structure is fitted to them.

    Parameters
    ----------
    model : file; None for the base model of the ``mechanism``
    unit : of an axis' position, "rad" or "m"
    strict : refuse all logs where one cannot be used

    Raises
    ------
    InputError
        If the model or all logs cannot be used, or there is no such mechanism.
    """
    from identification.logs.reading import read_usable_logs
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
    read, aside = read_usable_logs(logs, of.joints, strict=strict, geometry=lengths or own)
    return Inputs(start or of.start(read, unit), read, lengths, aside)
