"""List the effects that a model can have; print equations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.padding import Padding

from youbot_scripts.cli import run_script
from youbot_scripts.shared.effect_points import site_tables, sites_to_dict
from youbot_scripts.shared.effect_tables import describe, printed_catalogue, table
from youbot_scripts.shared.options import JsonOption, console, write_result
from youbot_scripts.shared.tables import show

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
    "youbot effects --points",
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
    points: Annotated[
        bool,
        typer.Option("--points", help="List what an effect of your own can read at each site."),
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
    of = printed_catalogue(mechanism)
    chosen = [of.catalogue[name] for name in names] if names else list(of.catalogue)
    if points:
        show(console(json), site_tables())
        write_result(json, {"sites": sites_to_dict()})
        return
    form = "latex" if latex else "text"
    result: dict[str, Any] = {"effects": [describe(item, of) for item in chosen]}
    screen = console(json)
    if equations:
        result["equations"] = of.equation(names or (), form).splitlines()
        screen.print("\n".join(result["equations"]), soft_wrap=True)
    else:
        show(screen, [table(chosen, of)])
        for item in chosen:
            formula = of.formula(item, form)
            screen.print(item.name)
            for line in (formula, item.recognise):
                # On a screen a long line goes on below its beginning; in a file it stays one.
                indented = Padding(line, (0, 0, 0, 2)) if screen.is_terminal else f"  {line}"
                screen.print(indented, soft_wrap=not screen.is_terminal)
    write_result(json, result)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
