"""A user's own controller from a Python file, told apart by the file's name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from copy import copy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from controllers.interface import Array, Controller, Loop, Observation, Reference
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics.effect import WORLD, Place
from youbot_env.plugins import fault_in_file, run_file

FACTORY = "controller"
"""Name of the function that makes a file's controller, where it holds one."""


def is_user_file(name: str) -> bool:
    """Whether a controller's name is that of a file: FILE.py, or FILE.py:NAME."""
    return _split(name)[0].endswith(".py")


def user_controller(name: str, model: Model, loop: Loop, **settings: Any) -> UserController:
    """The controller of a file, built for a model and a loop.

    The file holds a function ``controller(model, loop)``, or one class with ``reset`` and
    ``__call__``; of several, ``FILE.py:NAME`` names one. A class is built with (model, loop) where
    it takes two arguments, with (model) where it takes one, and with none otherwise.

    Raises
    ------
    InputError
        If the file cannot be run, holds no controller or several, or building one fails: one line
        with file and row.
    """
    path, wanted = _split(name)
    maker = _maker(run_file(path), path, wanted)
    try:
        made = maker(*_arguments(maker, model, loop), **settings)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # the user's own code may raise anything
        raise fault_in_file(path, error) from None
    if not isinstance(made, Controller):
        raise InputError(
            f"{path}: {_name_of(maker)} makes a {type(made).__name__}, which is no controller: it "
            "needs reset() and __call__(observation, reference)"
        )
    return UserController(path, made)


class UserController:
    """A user's controller; what it raises or returns wrongly is told with file and row.

    Attributes
    ----------
    preview_needed : coming reference samples that it reads, 0 unless it has such an attribute
    """

    def __init__(self, path: str, inner: Controller) -> None:
        self._path, self._inner = path, inner
        self.preview_needed = int(getattr(inner, "preview_needed", 0))

    def reset(self) -> None:
        """Forgets everything, as before the first call."""
        self._called(self._inner.reset)

    def __call__(self, observation: Observation, reference: Reference) -> Array:
        """Wheel torques (4,) [N m].

        Raises
        ------
        InputError
            If the user's code fails, or returns anything but four numbers.
        """
        found = self._called(self._inner, observation, reference)
        try:
            torque = np.array(found, dtype=float)
        except (TypeError, ValueError):
            torque = np.empty(0)
        if torque.shape != (4,):
            kind = f"shape {torque.shape}" if torque.size else f"a {type(found).__name__}"
            raise InputError(
                f"{self._path}: the controller returned {kind}; it must return four torques "
                "[N m], of fl, fr, bl, br"
            )
        return torque

    def _called(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except InputError:
            raise
        except Exception as error:
            raise fault_in_file(self._path, error) from None


class _Watched(Model):
    """A model that notes which places its inverse dynamics was not told."""

    left_out: set[str]

    def wrench(self, twist: ArrayLike, acceleration: ArrayLike, **at: ArrayLike) -> Array:
        self.left_out.update({"pose", "wheel_angle"} - set(at))
        return super().wrench(twist, acceleration, **at)

    def inverse_dynamics(self, twist: ArrayLike, acceleration: ArrayLike, **at: ArrayLike) -> Array:
        self.left_out.update({"pose", "wheel_angle"} - set(at))
        return super().inverse_dynamics(twist, acceleration, **at)


def left_out(name: str, model: Model, loop: Loop, *, show_pose: bool) -> str | None:
    """What a user's controller does not tell its model, though effects in it read it; in words.

    The controller is called once, at rest: it is what it asks of the model that is judged, not how
    it drives. None where nothing is left out, or the call fails.
    """
    reads = {"pose": _names(model, WORLD), "wheel_angle": []}
    if model.structure.depends_on_angle:
        reads["wheel_angle"] = [n for n in model.effects if n not in reads["pose"]]
    if not any(reads.values()):
        return None
    watched = copy(model)
    # The class alone changes: the model's numbers and what it has computed of them stay.
    object.__setattr__(watched, "__class__", _Watched)
    object.__setattr__(watched, "left_out", set())
    still = np.zeros(3)
    try:
        controller = user_controller(name, watched, loop)
        controller.reset()
        ahead = np.zeros((max(1, controller.preview_needed), 3))
        pose = still if show_pose else None
        controller(
            Observation(0.0, np.zeros(4), still, pose, np.zeros(4)),
            Reference(still, still, ahead, ahead),
        )
    except InputError:
        return None
    lost = [key for key, effects in reads.items() if effects and key in watched.left_out]  # pyright: ignore[reportAttributeAccessIssue]
    if not lost:
        return None
    effects = ", ".join(dict.fromkeys(e for key in lost for e in reads[key]))
    asked = ", ".join(f"{key}=..." for key in lost)
    return (
        f"{name} asks the model for torques without {asked}, which {effects} of the model reads: "
        "it is fed forward as at the start (docs/controllers.md, Your own, shows how to pass it)"
    )


def _names(model: Model, place: Place) -> list[str]:
    """The effects of a model that act at a place."""
    return [name for name in model.effects if model.effect(name).acts_at is place]


def _split(name: str) -> tuple[str, str]:
    path, colon, wanted = name.rpartition(":")
    # Without a colon all of it is the path; a drive's letter (C:\...) is none of ours.
    return (path, wanted) if colon and path.endswith(".py") else (name, "")


def _maker(module: ModuleType, path: str, wanted: str) -> Callable[..., Any]:
    """The function or class of a file that makes its controller."""
    own = {
        name: value
        for name, value in vars(module).items()
        if getattr(value, "__module__", None) == module.__name__ and not name.startswith("_")
    }
    classes = [name for name, value in own.items() if inspect.isclass(value) and _drives(value)]
    if wanted:
        if not callable(own.get(wanted)):
            known = ", ".join([*classes, *([FACTORY] if FACTORY in own else [])]) or "none"
            raise InputError(f"{path}: it holds no {wanted!r}; controllers in it: {known}")
        return own[wanted]
    if callable(own.get(FACTORY)):
        return own[FACTORY]
    if len(classes) == 1:
        return own[classes[0]]
    if classes:
        raise InputError(f"{path}: holds {', '.join(classes)}; name one: {path}:{classes[0]}")
    raise InputError(
        f"{path}: holds no controller: a class with reset() and __call__(observation, reference), "
        f"or a function {FACTORY}(model, loop) that makes one"
    )


def _drives(kind: type) -> bool:
    return all(callable(getattr(kind, name, None)) for name in ("reset", "__call__"))


def _arguments(maker: Callable[..., Any], model: Model, loop: Loop) -> list[Any]:
    """As many of (model, loop) as a maker needs."""
    try:
        parameters = inspect.signature(maker).parameters.values()
    except (TypeError, ValueError):
        return [model, loop]
    places = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    named = {p.name for p in places}
    # An argument with a default is given only if its name asks for it.
    needed = sum(p.default is p.empty for p in places)
    count = max(needed, 2 * ("loop" in named), "model" in named)
    return [model, loop][: min(count, 2)]


def _name_of(maker: Callable[..., Any]) -> str:
    return getattr(maker, "__name__", "it")


def file_of(name: str) -> Path:
    """The path of a controller's file."""
    return Path(_split(name)[0])
