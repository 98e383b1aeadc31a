"""The catalogues of effects as tables and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from youbot_env.physics.effect import in_brackets
from youbot_env.physics.mecanum import mecanum_structure
from youbot_scripts.shared.tables import Table, columns, number, text

if TYPE_CHECKING:
    from youbot_env.physics.effect import Effect, Registry
    from youbot_scripts.shared.report_page import Formulas

TYPICAL = {
    "1": "", "s": "", "kg": "F/a", "N": "F", "N/s": "F/s", "N/m": "F/x", "N s/m": "F/v",
    "N s^2/m^2": "F/v^2", "m": "x", "m/s": "v",
}  # fmt: skip
"""By unit: the typical quantity of which sizes of an axis' effects are multiples."""

TYPICAL_NOTE = (
    "Sizes are multiples of what is typical in the logs: F, v, a rms force, speed, acceleration; "
    "x the travel. Of an axis that turns, N is N m and m is rad."
)


class PrintedCatalogue(NamedTuple):
    """A mechanism's catalogue of effects, and how they are printed.

    Attributes
    ----------
    formula : of an effect, as "text" or "latex"
    equation : of motion, of the base model with the named effects, as "text" or "latex"
    unit_of : from a parameter's unit to the quantity of which its size is a multiple ("": none)
    note : below the table
    """

    catalogue: Registry
    formula: Callable[..., str]
    equation: Callable[[Sequence[str], Any], str]
    unit_of: Callable[[str], str]
    note: str


def printed_catalogue(mechanism: str) -> PrintedCatalogue:
    """The catalogue of a mechanism.

    Raises
    ------
    InputError
        If there is no mechanism of this name.
    """
    from identification.mechanisms.registry import kind

    if kind(mechanism) is kind("axis"):
        from identification.mechanisms import axis_printing
        from identification.mechanisms.axis_effects import AXIS_CATALOGUE

        formula, equation = axis_printing.formula, axis_printing.equation
        return PrintedCatalogue(
            AXIS_CATALOGUE, formula, equation, lambda unit: TYPICAL[unit], TYPICAL_NOTE
        )
    from youbot_env.equations.equations import equation, formula
    from youbot_env.physics.effect import CATALOGUE

    return PrintedCatalogue(
        CATALOGUE,
        formula,
        lambda names, form: equation(mecanum_structure(tuple(names)), form),
        lambda unit: "",
        "",
    )


def describe(item: Effect, of: PrintedCatalogue) -> dict[str, Any]:
    """An effect as JSON; sizes, defaults and bounds of an axis are multiples of "times"."""
    return {
        "name": item.name,
        "acts_at": item.acts_at.name,
        "kind": item.acts_at.kind,
        "parameters": {
            name: {
                "unit": parameter.unit,
                "size": parameter.size if parameter.default is None else None,
                "default": parameter.default,
                "lower": parameter.lower,
                "upper": parameter.upper,
                "relative_to": parameter.relative_to,
                **({"times": times} if (times := of.unit_of(parameter.unit)) else {}),
            }
            for parameter in item.public_parameters
            for name in parameter.names
        },
        "dissipative": item.dissipative,
        "formula": of.formula(item),
        "latex": of.formula(item, "latex"),
        "recognise": item.recognise,
        "source": item.source,
    }


def table(items: list[Effect], of: PrintedCatalogue) -> Table:
    """Where each effect acts, its parameters and sizes."""
    rows = tuple(
        (item.name, item.acts_at.name, parameters(item), sizes(item, of)) for item in items
    )
    headers = columns("effect", text("acts at"), text("parameters"), "catalogue\nsize")
    notes = (of.note,) if of.note else ()
    return Table("Effects", headers, rows, notes)


def parameters(item: Effect) -> str:
    """One parameter a line, with its unit."""
    return "\n".join(
        in_brackets(
            f"{parameter.name}{'_fl .. _br' if parameter.each_wheel else ''}", parameter.unit
        )
        for parameter in item.public_parameters
    )


def sizes(item: Effect, of: PrintedCatalogue) -> str:
    """Catalogue sizes in the order of the parameters; a shape constant's default in brackets."""
    found = []
    for parameter in item.public_parameters:
        value = parameter.size if parameter.default is None else parameter.default
        text = f"{number(value)} {of.unit_of(parameter.unit)}".strip()
        found.append(text if parameter.default is None else f"[{text}]")
    return "\n".join(found)


def equations_with(mechanism: str, effects: Sequence[str], missing: Sequence[str] = ()) -> Formulas:
    """The equations of the base model, and below them what each effect adds, for a page.

    Parameters
    ----------
    effects : that the model holds; those ``missing`` from it before are marked as new
    """
    from youbot_scripts.shared.report_page import Formulas

    printed = printed_catalogue(mechanism)
    rows = [(line, False, "") for line in printed.equation((), "latex").splitlines()]
    for name in effects:
        parts = printed.formula(printed.catalogue[name], "latex").split(";  ")
        rows += [(part, name in missing, name) for part in parts]
    lines, new, notes = zip(*rows, strict=True)
    return Formulas("Equations of motion", lines, new, notes)
