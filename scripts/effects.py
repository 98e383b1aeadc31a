"""List the effects that can be added to a model; print equations."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import JsonOption, console, write_result
from youbot_scripts.shared.tables import Table, columns, number, show as show_tables, text

if TYPE_CHECKING:
    from rich.console import Console

    from youbot_env.physics.effect import Effect, Registry

EffectsOption = Annotated[
    Path | None,
    typer.Option(
        "--effects",
        metavar="FILE.py",
        help="Run this Python file, which registers effects of your own.",
    ),
]

EXAMPLES = (
    "youbot effects",
    "youbot effects floor_tilt --equations",
    "youbot effects --effects my_effects.py --json effects.json",
    "youbot effects --mechanism axis",
)

TYPICAL = {
    "1": "", "s": "", "kg": "F/a", "N": "F", "N/s": "F/s", "N/m": "F/x", "N s/m": "F/v",
    "N s^2/m^2": "F/v^2", "m": "x", "m/s": "v",
}  # fmt: skip
"""What a size or default of an axis' effect is a multiple of, by unit."""

TYPICAL_NOTE = (
    "Sizes are multiples of what is typical in the logs: F, v, a rms force, speed, acceleration; "
    "x the travel. Of an axis that turns, N is N m and m is rad."
)


class ShownEffect(NamedTuple):
    """A catalogue and how it is printed.

    unit_of: what the size of a parameter with this unit is a multiple of ("": its unit)
    """

    catalogue: Registry
    formula: Callable[..., str]
    equation: Callable[[Sequence[str], Any], str]
    unit_of: Callable[[str], str]
    note: str


def main(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[EFFECT]...", help="Show only these effects.", show_default=False),
    ] = None,
    equations: Annotated[
        bool,
        typer.Option(
            "--equations",
            help="Print the equations of motion of the base model with the effects named.",
        ),
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="Print formulas as LaTeX.")] = False,
    effects: EffectsOption = None,
    mechanism: Annotated[
        str, typer.Option("--mechanism", metavar="NAME", help="Of what: mecanum, axis.")
    ] = "mecanum",
    json: JsonOption = None,
) -> None:
    """List the effects that can be added to a model.

    For each: where it acts, its parameters with units, their catalogue size (the size at which the
    base model's force error is some 3 to 20 times the noise floor; a shape constant's default in
    brackets), its formula (what it adds to the torque or force that a motion demands), and how to
    recognise it in measurements.

    --effects runs a Python file of your own that registers effects with youbot_env.effect, and
    lists them too.
    """
    from youbot_env.plugins import load_effects, load_installed_effects

    load_installed_effects()
    if effects is not None:
        load_effects(effects)
    of = shown(mechanism)
    chosen = [of.catalogue[name] for name in names] if names else list(of.catalogue)
    form = "latex" if latex else "text"
    result: dict[str, Any] = {"effects": [describe(item, of) for item in chosen]}
    screen = console(json)
    if equations:
        result["equations"] = of.equation(names or (), form).splitlines()
        screen.print("\n".join(result["equations"]), soft_wrap=True)
    else:
        show(screen, chosen, of, form)
    write_result(json, result)


def shown(mechanism: str) -> ShownEffect:
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
        return ShownEffect(
            AXIS_CATALOGUE, formula, equation, lambda unit: TYPICAL[unit], TYPICAL_NOTE
        )
    from youbot_env.equations.equations import equation, formula
    from youbot_env.physics.effect import CATALOGUE
    from youbot_env.physics.structure import ModelStructure

    return ShownEffect(
        CATALOGUE,
        formula,
        lambda names, form: equation(ModelStructure(tuple(names)), form),
        lambda unit: "",
        "",
    )


def describe(item: Effect, of: ShownEffect) -> dict[str, Any]:
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


def show(screen: Console, items: list[Effect], of: ShownEffect, form: str) -> None:
    """Print the catalogue: a table, then for each effect how to recognise it."""
    rows = tuple(
        (item.name, item.acts_at.name, parameters(item), sizes(item, of)) for item in items
    )
    headers = columns("effect", text("acts at"), text("parameters"), "catalogue\nsize")
    notes = (of.note,) if of.note else ()
    show_tables(screen, [Table("Effects", headers, rows, notes)])
    for item in items:
        screen.print(f"{item.name}\n  {of.formula(item, form)}\n  {item.recognise}", soft_wrap=True)


def parameters(item: Effect) -> str:
    """One parameter a line, with its unit."""
    return "\n".join(
        f"{parameter.name}{'_fl .. _br' if parameter.each_wheel else ''} [{parameter.unit}]"
        for parameter in item.public_parameters
    )


def sizes(item: Effect, of: ShownEffect) -> str:
    """Catalogue sizes in the order of the parameters; a shape constant's default in brackets."""
    found = []
    for parameter in item.public_parameters:
        value = parameter.size if parameter.default is None else parameter.default
        text = f"{number(value)} {of.unit_of(parameter.unit)}".strip()
        found.append(text if parameter.default is None else f"[{text}]")
    return "\n".join(found)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
