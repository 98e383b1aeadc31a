"""Say which physical effect a model lacks on logs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared.options import (
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
    ReportOption,
    SeedOption,
    check_pictures,
    console,
    number,
    percent,
    progress,
    write_result,
    write_text,
)
from youbot_scripts.shared.tables import Table, show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.diagnosis.report import Diagnosis
    from identification.logs.log import Log
    from youbot_scripts.shared.report_page import Part

EXAMPLES = (
    "youbot diagnose model.json runs/*.csv -o better.json",
    "youbot diagnose paper runs/*.csv --effects my_effects.py --report diagnosis.html",
)


def main(
    model: ModelArgument,
    logs: LogsArgument,
    output: OutputModelOption = None,
    effects: Annotated[
        Path | None,
        typer.Option("--effects", metavar="FILE.py", help="Your own effects; runs this file."),
    ] = None,
    next_motion: Annotated[
        Path | None,
        typer.Option(
            "--next-motion", metavar="FILE", help="Write the proposed motion here, for `record`."
        ),
    ] = None,
    mechanism: MechanismOption = None,
    report: ReportOption = None,
    json: JsonOption = None,
    seed: SeedOption = 0,
) -> None:
    """Rank the catalogue's effects by held-out error and name what is missing, or say it cannot.

    MODEL's structure is the start; its parameters are fitted again. Each log in turn is held out
    (one log alone: five blocks). Prints the error as it falls, beside the noise floor. Works in a
    thread a core, four at most; the environment variable YOUBOT_THREADS says otherwise.
    """
    from identification.diagnosis.diagnose import diagnose
    from identification.logs.reading import read_logs
    from identification.mechanisms.registry import (
        check_mechanism,
        kind_of,
        load_any_model,
        save_any_model,
    )
    from youbot_env.plugins import load_effects

    check_pictures(None, report)
    if effects:
        load_effects(effects)
    loaded = load_any_model(model)
    check_mechanism(loaded, mechanism)
    read = read_logs(logs, kind_of(loaded).joints, geometry=getattr(loaded, "geometry", None))
    with progress(40, "diagnose") as advance:
        result = diagnose(loaded, read, seed=seed, progress=advance)
    out = console(json)
    _print(out, result)
    if next_motion and result.next_experiment:
        from youbot_scripts.shared.options import write_json

        write_json(next_motion, result.next_experiment["motion"])
        out.print(f"motion written to {next_motion}", soft_wrap=True)
    write_result(json, result.to_dict(), seed)
    if report:
        from youbot_scripts.shared.report_page import facts, page

        title = f"What is missing from the model: {loaded.name}"
        write_text(report, page(title, _parts(result, loaded, read), facts(seed)))
        out.print(f"report written to {report}", soft_wrap=True)
    if output:  # last: where the logs do not show a model, all else is there
        save_any_model(output, result.model)
        out.print(f"model written to {output}", soft_wrap=True)


def _print(out: Console, result: Diagnosis) -> None:
    show(out, [_steps(result), _candidates(result, 4)])
    shares = [row for row in result.where if row["share"] > 0][:6]
    if shares:
        rows = tuple((row["variable"], percent(row["share"])) for row in shares)
        show(out, [Table("Residual by variable", ("variable", "share of it"), rows)])
    out.print(f"Verdict: {result.verdict}", style="bold")
    for sentence in result.sentences:
        out.print(f"- {sentence}")
    for line in _next(result):
        out.print(line)
    for warning in result.warnings:
        out.print(f"warning: {warning}", style="yellow")


def _steps(result: Diagnosis) -> Table:
    from youbot_scripts.shared import tables as result_tables

    rows = [(step.effect or "the model, refitted", step.to_dict()) for step in result.steps]
    rows.append(("noise floor", result.noise_floor))
    return result_tables.errors("The error as it falls", rows)


def _candidates(result: Diagnosis, most: int | None = None) -> Table:
    rows = tuple(
        (row["effect"], percent(row["force_error"]), number(row["p_value"], 2), _sizes(row))
        for row in result.candidates[:most]
    )
    headers = ("effect", "force error", "p", "at")
    return Table("Candidates, best first", headers, rows, left=("at",))


def _next(result: Diagnosis) -> list[str]:
    """The motion that tells apart what is tied, if there is one."""
    if not result.next_experiment:
        return []
    apart = " and ".join(result.next_experiment["separates"])
    return [f"Next experiment: motion {result.next_experiment['name']} tells {apart} apart"]


def _parts(result: Diagnosis, given: Any, read: Sequence[Log]) -> Iterator[Part]:
    """The web page: the verdict first, then how it came about."""
    from identification.figures.figures import figures_of_diagnosis
    from youbot_scripts.shared import tables as result_tables
    from youbot_scripts.shared.report_page import Words, pictures

    yield Words([f"Verdict: {result.verdict}", *result.sentences, *_next(result)], "verdict")
    yield Words(result.warnings, "warning")
    yield _steps(result)
    drawn = {picture.name: picture for picture in pictures(figures_of_diagnosis(result, given))}
    yield drawn["errors"]
    if result.fitted_model is not None:
        yield result_tables.parameters(result_tables.of_model(result.model), "Refitted parameters")
    yield _candidates(result)
    titles = {
        "residual": "What the residual of the refitted model depends on",
        "remaining": "What remains, with all of the above",
    }
    for (name, title), found in zip(titles.items(), result.maps, strict=False):
        yield result_tables.residual(title, found.to_list())
        if name in drawn:
            yield drawn[name]
    yield result_tables.errors("The model as it was given", [(given.name, result.given_model)])
    yield result_tables.logs(read)


def _sizes(row: dict) -> str:
    return ", ".join(
        f"{name} {number(entry['value'], 3)}" for name, entry in row["parameters"].items()
    )


if __name__ == "__main__":
    sys.exit(run_script(__file__))
