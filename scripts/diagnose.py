"""Say which physical effect a model lacks on logs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.inputs import Inputs, read_inputs
from youbot_scripts.shared.options import (
    EffectsOption,
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
    ReportOption,
    SeedOption,
    StrictOption,
    check_pictures,
    console,
    progress,
    write_json,
    write_result,
)
from youbot_scripts.shared.tables import percent, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.diagnosis.report import Diagnosis
    from youbot_scripts.shared.report_page import Part

EXAMPLES = (
    "youbot diagnose model.json runs/*.csv -o better.json",
    "youbot diagnose paper runs/*.csv --effects my_effects.py --report diagnosis.html",
)


SHOWN_CANDIDATES = 4
"""Candidates listed in the terminal; page and JSON list all of them."""


def main(
    model: ModelArgument,
    logs: LogsArgument,
    output: OutputModelOption = None,
    effects: EffectsOption = None,
    next_motion: Annotated[
        Path | None,
        typer.Option(
            "--next-motion", metavar="FILE", help="Write the proposed motion here, for `record`."
        ),
    ] = None,
    mechanism: MechanismOption = None,
    report: ReportOption = None,
    strict: StrictOption = False,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Rank the catalogue's effects by held-out error and name what is missing, or say it cannot.

    MODEL's structure is the start; its parameters are fitted again. Each log in turn is held out
    (one log alone: five blocks). Prints the error as it falls, beside the noise floor. Works in a
    thread a core, four at most; the environment variable YOUBOT_THREADS says otherwise.
    """
    # Imported here: `youbot diagnose --help` does without numpy and scipy.
    from identification.diagnosis.diagnose import diagnose
    from identification.mechanisms.registry import save_any_model

    check_pictures(None, report)
    given = read_inputs(model, logs, effects=effects, mechanism=mechanism, strict=strict)
    with progress(40, "diagnose") as advance:
        result = diagnose(given.model, given.logs, seed=seed, progress=advance)
    out, found = console(json), {**result.to_dict(), **given.to_dict()}
    given.tell(out)
    _print(out, found, len(result.first_warnings))
    if next_motion and found["next_experiment"]:
        write_json(next_motion, found["next_experiment"]["motion"])
        out.print(f"motion written to {next_motion}", soft_wrap=True)
    write_result(json, found, seed)
    if report:
        from youbot_scripts.shared.report_page import write_page

        title = f"What is missing from the model: {given.model.name}"
        write_page(report, title, _page(result, found, given), seed)
        out.print(f"report written to {report}", soft_wrap=True)
    if output:
        save_any_model(output, result.model)
        out.print(f"model written to {output}", soft_wrap=True)


def _print(out: Console, found: dict[str, Any], told_first: int) -> None:
    # What makes the numbers doubtful comes before them.
    if found["verdict"] == "unknown":
        line = "warning: verdict unknown: these logs hold something that no effect explains"
        line += "; what is named below is not all of it" if found["missing"] else ""
        out.print(line, style="yellow", soft_wrap=True)
    for warning in found["warnings"][:told_first]:
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    show(out, [result_tables.steps(found), result_tables.candidates(found, SHOWN_CANDIDATES)])
    # What remains after the effects found, where there are any: the rest is explained.
    accepted = bool(found["missing"])
    title = "What remains, by variable" if accepted else "Residual by variable"
    show(
        out,
        result_tables.leading_variables(found["remaining" if accepted else "where"], title=title),
    )
    out.print(f"Verdict: {found['verdict']}", style="bold")
    for sentence in [*found["words"], *found["changes"]["words"]]:
        out.print(f"- {sentence}")
    for line in _next_experiment(found):
        out.print(line)
    for warning in found["warnings"][told_first:]:
        out.print(f"warning: {warning}", style="yellow")


_HEADLINES = {
    "adequate": "Nothing is missing that these logs could show",
    "effect": "The model lacks {missing}",
    "ambiguous": "The model lacks {missing}, or what these logs cannot tell from it",
    "unknown": "Something is missing that no effect of the catalogue explains",
}


def _headline(found: dict[str, Any]) -> str:
    """The verdict in one sentence, with how far the error falls."""
    names = " and ".join(name.replace("_", " ") for name in found["missing"])
    line = _HEADLINES[found["verdict"]].format(missing=names)
    if found["verdict"] == "unknown" and names:
        line = f"The model lacks {names}, and something that no effect of the catalogue explains"
    first, *_, last = [percent(found["steps"][k]["force_error"]) for k in (0, -1)]
    noise = f"noise {percent(found['noise_floor']['force_error'])}"
    if len(found["steps"]) > 1:
        return f"{line}: the force error falls from {first} to {last} ({noise})."
    return f"{line}: force error {first}, {noise}."


def _next_experiment(found: dict[str, Any]) -> list[str]:
    """The motion that best separates tied effects, if there is one."""
    proposed = found["next_experiment"]
    if not proposed:
        return []
    apart = " and ".join(proposed["separates"])
    return [f"Next experiment: motion {proposed['name']} tells {apart} apart"]


def _page(result: Diagnosis, found: dict[str, Any], given: Inputs) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.figures.charts import charts_of_diagnosis
    from youbot_scripts.shared.effect_tables import equations_with
    from youbot_scripts.shared.report_page import Charts, Words, groups_of

    lines = [_headline(found), *found["words"], *found["changes"]["words"]]
    yield Words([*lines, *_next_experiment(found)], "verdict")
    yield Words(found["warnings"], "warning")
    charts = {chart.name: chart for chart in charts_of_diagnosis(result, given.model)}
    yield Charts([charts.pop("errors")])
    yield result_tables.steps(found)
    for name in ("next", "residual", "forces_0"):
        if name in charts:
            yield Charts([charts.pop(name)])
    yield from groups_of(charts)
    yield result_tables.candidates(found)
    yield equations_with(result.model.mechanism.name, result.mechanism.structure.effects, found)
    model = result_tables.of_model(result.model)
    yield result_tables.parameters(model, "Refitted parameters")
    titles = (
        "What the residual of the refitted model depends on",
        "What remains after the effects",
    )
    # Without an accepted effect there is no second map.
    for title, residual_map in zip(titles, result.maps, strict=False):
        yield result_tables.residual(title, residual_map.to_list())
    as_given = [(given.model.name, found["given_model"])]
    yield result_tables.errors("The model as it was given", as_given)
    yield result_tables.logs(given.logs)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
