"""Controllers by name, each built on a model for a loop; modules are imported when one is built."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from controllers.interface import Controller, Loop
from youbot_env.errors import InputError
from youbot_env.model import Model

Settings = Mapping[str, Any]
"""Numbers and texts by name, JSON-able, that a factory takes beside model and loop."""


@dataclass(frozen=True)
class Entry:
    """One name of the registry.

    Attributes
    ----------
    build : ``(model, loop, **settings) -> Controller``, quick
    summary : one line for a user who has to choose
    design : ``(model, loop, **options) -> settings`` of ``build``, where finding them takes a
        search that is worth keeping; None where ``build`` does all
    """

    build: Callable[..., Controller]
    summary: str
    design: Callable[..., Settings] | None = None


def _kinematic(model: Model, loop: Loop, **settings: Any) -> Controller:
    from controllers.kinematic import Gains, KinematicControl

    return KinematicControl(model.geometry, Gains(**settings), loop.torque_limit, loop.sample_time)


CONTROLLERS: dict[str, Entry] = {
    "kinematic": Entry(_kinematic, "wheel-speed PI, gains like the stock ones"),
}
"""Every controller that a name alone stands for."""


def entry(name: str) -> Entry:
    """The entry of a name.

    Raises
    ------
    InputError
        If there is none: with the names that come closest.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    close = difflib.get_close_matches(name, CONTROLLERS, 3)
    hint = f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(CONTROLLERS)}"
    raise InputError(f"controller {name!r}: not known; {hint}")


def build(name: str, model: Model, loop: Loop, **settings: Any) -> Controller:
    """The controller of a name.

    Parameters
    ----------
    model : what the controller believes of the platform
    loop : where it will run
    settings : of this controller; where none are given and it has a ``design``, that is made first

    Raises
    ------
    InputError
        If the name is unknown, or the controller cannot be built on this model.
    """
    found = entry(name)
    if found.design is not None and not settings:
        settings = dict(found.design(model, loop))
    return found.build(model, loop, **settings)
