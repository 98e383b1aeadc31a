"""The tables of a tuned controller."""

from __future__ import annotations

import importlib.util

import numpy as np

from controllers.tuning.controller_tuning import TunedController
from controllers.tuning.gains_file import gains_to_dict
from youbot_scripts.shared.tables import Column, Table, columns, decimals, number, percent, text

AXES = ("VX", "VY", "W")

SHOWN_POLES = 8
"""Poles that are listed, the slowest first."""


def results(title: str, found: TunedController) -> Table:
    """Errors, effort and margins of each of the gains found."""
    shown = (
        *(Column(axis, percent) for axis in AXES),
        Column("N m/s", decimals(3)),
        Column("gain dB", decimals(2)),
        Column("phase deg", decimals(1)),
        Column("saturated", percent),
    )
    rows = tuple(
        (
            name,
            *one.error.tolist(),
            one.torque_rate,
            one.margins.gain.min(),
            one.margins.phase.min(),
            one.saturated,
        )
        for name, one in found.points.items()
    )
    return Table(title, columns("gains", *shown), rows)


def gains(found: TunedController) -> Table:
    """The gains by what they had to keep."""
    values = {name: gains_to_dict(one)["gains"] for name, one in found.gains.items()}
    rows = tuple(
        (key, *(one[key]["value"] for one in values.values()), entry["unit"])
        for key, entry in values["tuned"].items()
    )
    shown = (*(Column(name, number) for name in values), text("unit"))
    return Table("Gains", columns("name", *shown), rows)


def margins(found: TunedController) -> Table:
    """Margins of each axis, with python-control's beside them where it is installed."""
    own = found.points["tuned"].margins
    values, headers = [own.gain, own.phase], ["gain dB", "phase deg"]
    if importlib.util.find_spec("control"):
        theirs = found.python_control_margins()
        values += [theirs.gain, theirs.phase]
        headers += ["python-control: dB", "deg"]
    rows = tuple((axis, *(value[i] for value in values)) for i, axis in enumerate(AXES))
    shown = (Column(header, decimals(2)) for header in headers)
    return Table("Margins of the tuned loop", columns("axis", *shown), rows)


def poles(found: TunedController) -> str:
    """The slowest poles of the tuned loop in a line; of a conjugate pair the upper one."""
    every = found.points["tuned"].poles
    upper = [pole for pole in every[np.isfinite(every)].tolist() if pole.imag >= 0]
    return "Slowest poles [1/s]: " + ", ".join(map(_pole, upper[:SHOWN_POLES]))


def _pole(pole: complex) -> str:
    return f"{pole.real:.3g}" if abs(pole.imag) < 1e-9 else f"{pole.real:.3g} ± {pole.imag:.3g}j"
