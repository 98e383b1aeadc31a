"""The exception that a user's mistake raises, the checks that raise it, and what settings are."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from importlib import import_module
from numbers import Integral, Real
from typing import Any

LONGEST_MESSAGE = 2000
"""Characters of an error: the longest list of names that one holds has a thousand."""

END_KEPT = 400
"""Characters at the end of a longer one, where its cure stands."""


class InputError(ValueError):
    """Input that cannot be used.

    ``str(error)`` is one line that says what is wrong, where (file, row, column) and what to do
    about it; the command line prints it and exits with status 2. Whatever a file or a name brings
    into it, it holds printable characters only, and at most ``LONGEST_MESSAGE`` of them.
    """

    def __init__(self, message: str) -> None:
        super().__init__(shortened(visible(" ".join(shortened(str(message)).splitlines()))))


def shortened(text: str, most: int = LONGEST_MESSAGE) -> str:
    """A text without its middle if it is longer than ``most`` characters."""
    if len(text) <= most:
        return text
    return f"{text[: most - END_KEPT - 5]} ... {text[-END_KEPT:]}"


def visible(text: str) -> str:
    """A text as a terminal may show it: control characters, among them those that colour a
    terminal or turn its text around, and bytes of names that are no UTF-8 become escapes."""
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() else _escaped(sign) for sign in text)


def _escaped(sign: str) -> str:
    # Spaces of other widths are harmless, and units hold them.
    return " " if sign.isspace() and ord(sign) > 0x9F else sign.encode("unicode_escape").decode()


def finite(what: str, value: Any, *, positive: bool = False, least: float | None = None) -> float:
    """``value`` as a float.

    Raises
    ------
    InputError
        If it is not a finite (and, on request, positive or large enough) real number; names
        ``what``.
    """
    # bool is a subclass of int, so True would pass for the number 1.
    real = isinstance(value, Real) and not isinstance(value, bool)
    try:
        number = float(value) if real else math.nan
    except OverflowError:  # an integer above the largest float
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{what}: {value!r} is not a finite number")
    if positive and number <= 0.0:
        raise InputError(f"{what}: {value!r} must be positive")
    if least is not None and number < least:
        raise InputError(f"{what}: {number:g} must be at least {least:g}")
    return number


def count(what: str, value: Any, least: int = 1, most: int | None = None) -> int:
    """``value`` as a whole number between ``least`` and ``most``, or InputError that names
    ``what``."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{what}: {value!r} is not a whole number of at least {least}")
    number = int(value)
    if most is not None and number > most:
        raise InputError(f"{what}: {value!r} is more than {most}")
    return number


@dataclass(frozen=True)
class Settings:
    """Numbers that a result depends on: the base of classes of settings that are shown as JSON."""

    def to_dict(self) -> dict[str, Any]:
        """JSON form: the numbers in force by name."""
        return asdict(self)


def check_settings(settings: Any, what: str = "", *, positive: bool = False) -> None:
    """Checks the numbers of a dataclass of settings: whole ones at least 1, others at least 0.

    A whole number whose default is 0 (for "all", or "none") may be 0.

    Parameters
    ----------
    what : names the settings in an error; without it the class does
    positive : whether other numbers must be positive, unless they are in a tuple whose default
        starts at 0

    Raises
    ------
    InputError
        If one cannot be: names the settings and the field.
    """
    label = f"{what}: " if what else f"{type(settings).__name__} "
    # The type of the default tells what a value must be. Nested settings have no such default; they
    # check themselves.
    for item in fields(settings):
        value, is_tuple = getattr(settings, item.name), isinstance(item.default, tuple)
        wanted: tuple[Any, ...] = (
            item.default if isinstance(item.default, tuple) else (item.default,)
        )
        given = value if isinstance(value, (tuple, list)) else (value,)
        for k, one in enumerate(given):
            default = wanted[min(k, len(wanted) - 1)]
            # Before int: a bool is an int in Python, and every bool is allowed.
            if isinstance(default, bool):
                continue
            if isinstance(default, int):
                count(label + item.name, one, least=min(default, 1))
            elif isinstance(default, float):
                above_zero = positive and not (is_tuple and wanted[0] <= 0)
                finite(label + item.name, one, positive=above_zero, least=0.0)


def optional_library(name: str, extra: str, need: str, instead: str = "") -> Any:
    """A library that only an extra of this package brings.

    Parameters
    ----------
    name : of the module, such as ``control``
    extra : of this package that installs it
    need : the first half of the error, such as "this export needs torch"
    instead : what else can be done, such as "use .csv"

    Raises
    ------
    InputError
        If it is not installed: says what needs it and how to install it.
    """
    try:
        return import_module(name)
    except ImportError:
        other = f", or {instead}" if instead else ""
        raise InputError(f"{need}: pip install 'youbot[{extra}]'{other}") from None


class NoTorqueError(InputError):
    """Losses that grow with the torque take all of it: no torque drives a motion."""
