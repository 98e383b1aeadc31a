"""List the effects that can be added to a model; print equations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.common import JsonOption, console, number, show_table, write_result

if TYPE_CHECKING:
    from rich.console import Console

    from youbot_env.effects import Effect

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
)


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
    json: JsonOption = None,
) -> None:
    """List the effects that can be added to a model.

    For each: where it acts, its parameters with units, their catalogue size (the size at which the
    effect matters; a shape constant's default in brackets), its formula (what it adds to the torque
    or force that a motion demands), and how to recognise it in measurements.

    --effects runs a Python file of your own that registers effects with
    youbot_env.effects.effect, and lists them too.
    """
    from youbot_env.dynamics import Structure
    from youbot_env.effects import CATALOGUE
    from youbot_env.plugins import load_effects, load_installed_effects
    from youbot_env.symbolic import equation, formula

    load_installed_effects()
    if effects is not None:
        load_effects(effects)
    chosen = [CATALOGUE[name] for name in names] if names else list(CATALOGUE)
    form = "latex" if latex else "text"
    result: dict[str, Any] = {"effects": [describe(item) for item in chosen]}
    screen = console(json)
    if equations:
        result["equations"] = equation(Structure(tuple(names or ())), form).splitlines()
        screen.print("\n".join(result["equations"]), soft_wrap=True)
    else:
        show(screen, chosen, [formula(item, form) for item in chosen])
    write_result(json, result)


def describe(item: Effect) -> dict[str, Any]:
    """An effect as JSON."""
    from youbot_env.symbolic import formula

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
            }
            for parameter in item.public_parameters
            for name in parameter.names
        },
        "dissipative": item.dissipative,
        "formula": formula(item),
        "latex": formula(item, "latex"),
        "recognise": item.recognise,
        "source": item.source,
    }


def show(screen: Console, items: list[Effect], formulas: list[str]) -> None:
    """Print the catalogue: a table, then for each effect how to recognise it."""
    rows = [(item.name, item.acts_at.name, parameters(item), sizes(item)) for item in items]
    headers = ("effect", "acts at", "parameters", "size")
    show_table(screen, "Effects, at catalogue size", headers, rows, left=("acts at", "parameters"))
    for item, printed in zip(items, formulas, strict=True):
        screen.print(f"{item.name}\n  {printed}\n  {item.recognise}", soft_wrap=True)


def parameters(item: Effect) -> str:
    """One parameter a line, with its unit."""
    return "\n".join(
        f"{parameter.name}{'_fl .. _br' if parameter.each_wheel else ''} [{parameter.unit}]"
        for parameter in item.public_parameters
    )


def sizes(item: Effect) -> str:
    """Catalogue sizes in the order of the parameters; a shape constant's default in brackets."""
    return "\n".join(
        number(parameter.size) if parameter.default is None else f"[{number(parameter.default)}]"
        for parameter in item.public_parameters
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
