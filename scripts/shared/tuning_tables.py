"""The tables of a tuned controller, made from the JSON form of the result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from youbot_env.physics.effect import shown_unit
from youbot_scripts.shared.tables import Column, Table, columns, decimals, number, percent, text

AXES = ("VX", "VY", "W")

SHOWN_POLES = 8
"""Poles that are listed, the slowest first."""

Found = Mapping[str, Any]


def tables(
    title: str, found: Found, by_python_control: Mapping[str, list[float]] | None
) -> list[Table]:
    """All tables; margins also by python-control, if it is installed."""
    return [results(title, found), gains(found), margins(found, by_python_control)]


def results(title: str, found: Found) -> Table:
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
            *one["error"],
            one["torque_rate"],
            min(one["margins"]["gain_db"]),
            min(one["margins"]["phase_degrees"]),
            one["saturated"],
        )
        for name, one in found["results"].items()
    )
    return Table(title, columns("gains", *shown), rows)


def gains(found: Found) -> Table:
    """The gains found under each set of requirements."""
    values = {name: one["gains"] for name, one in found["results"].items()}
    rows = tuple(
        (key, *(one[key]["value"] for one in values.values()), shown_unit(entry["unit"]))
        for key, entry in found["gains"].items()
    )
    shown = (*(Column(name, number) for name in values), text("unit"))
    return Table("Gains", columns("name", *shown), rows)


def margins(found: Found, by_python_control: Mapping[str, list[float]] | None) -> Table:
    """Margins of the tuned loop by axis; also by python-control, if it is installed."""
    own, theirs = found["results"]["tuned"]["margins"], by_python_control or {}
    headers = ("gain dB", "phase deg", "python-control: dB", "deg")
    values = [*own.values(), *theirs.values()]
    rows = tuple((axis, *(value[i] for value in values)) for i, axis in enumerate(AXES))
    shown = (Column(header, decimals(2)) for header in headers[: len(values)])
    return Table("Margins of the tuned loop", columns("axis", *shown), rows)


def poles(found: Found) -> str:
    """The slowest poles of the tuned loop in a line; of a conjugate pair the upper one."""
    upper = [pole for pole in found["results"]["tuned"]["poles"] if pole[1] >= 0]
    return "Slowest poles [1/s]: " + ", ".join(_pole(*pole) for pole in upper[:SHOWN_POLES])


def _pole(real: float, imaginary: float) -> str:
    return f"{real:.3g}" if abs(imaginary) < 1e-9 else f"{real:.3g} ± {imaginary:.3g}j"
