"""Say which physical effect a model lacks on logs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.inputs import read_inputs
from youbot_scripts.shared.options import (
    EffectsOption,
    JsonOption,
    LogsArgument,
    MechanismOption,
    ModelArgument,
    OutputModelOption,
    PlotsOption,
    ReportOption,
    SeedOption,
    StrictOption,
    check_output,
    check_pictures,
    console,
    progress,
    write_json,
    write_result,
    write_text,
)
from youbot_scripts.shared.tables import show

if TYPE_CHECKING:
    from rich.console import Console

    from identification.diagnosis.report import Diagnosis


EXAMPLES = (
    "youbot diagnose model.json runs/*.csv -o better.json --plots plots/",
    "youbot diagnose paper runs/*.csv --effects my_effects.py --report diagnosis.html",
    "youbot diagnose model.json runs/*.csv -o better.json --proposal law.py",
)


SHOWN_CANDIDATES = 4
"""Candidates listed in the terminal; page and JSON list all of them."""


def check_law_file(path: Path | None) -> Path | None:
    """Typer callback: refuse a file that `--effects` could not take, before anything is computed.

    Raises
    ------
    InputError
        If it cannot be made, or its name does not end in .py.
    """
    if path is not None and path.suffix != ".py":
        from youbot_env.errors import InputError

        raise InputError(f"{path}: a law is written as Python; let its name end in .py")
    return check_output(path)


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
    proposal: Annotated[
        Path | None,
        typer.Option(
            "--proposal",
            metavar="FILE.py",
            callback=check_law_file,
            help="Write the law that is proposed for an unknown rest here, for `--effects`.",
        ),
    ] = None,
    mechanism: MechanismOption = None,
    plots: PlotsOption = None,
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

    check_pictures(plots, report)
    given = read_inputs(model, logs, mechanism=mechanism, strict=strict)
    with progress(40, "diagnose") as advance:
        result = diagnose(given.model, given.logs, seed=seed, progress=advance)
    out, found = console(json), {**result.to_dict(), **given.to_dict()}
    if proposal and result.proposal:
        found["proposal"]["file"] = str(proposal)
    # Before anything is printed: a reader that closes its pipe (`| head`) must not cost the model.
    if output:
        save_any_model(output, result.model)
    given.tell(out)
    _print(out, found, len(result.first_warnings))
    if next_motion and found["next_experiment"]:
        write_json(next_motion, found["next_experiment"]["motion"])
        out.print(f"motion written to {next_motion}", soft_wrap=True)
    if proposal:
        _write_law(out, proposal, result, model, output)
    write_result(json, found, seed)
    if plots:
        from identification.figures.figures import plot_diagnosis

        for path in plot_diagnosis(result, plots):
            out.print(f"plot written to {path}", soft_wrap=True)
    if report:
        from youbot_scripts.shared.pages import write_diagnosis

        write_diagnosis(report, result, found, given.logs, seed)
        out.print(f"report written to {report}", soft_wrap=True)
    if output:
        held = f", with {', '.join(result.missing)} in it" if result.missing else ""
        lacks = ", without the proposed law" if result.proposal else ""
        out.print(f"model written to {output}{held}{lacks}", soft_wrap=True)
    platform = result.model.mechanism.name == "mecanum"
    for line in next_lines(found, model, output, next_motion) if platform else ():
        out.print(f"next: {line}", soft_wrap=True, highlight=False)


def next_lines(
    found: dict[str, Any], model: str, output: Path | None, next_motion: Path | None
) -> Iterator[str]:
    """What to type next about a platform, where the verdict says what that is."""
    if found["next_experiment"]:
        if next_motion:
            yield f"youbot motions drive/ --next-motion {next_motion}, drive it, and diagnose again"
        else:
            yield "the same command with --next-motion FILE writes the motion that tells them apart"
    elif found["missing"] and output:
        yield f"youbot compare {output} LOG..., with logs that are none of these"
    elif found["missing"]:
        yield "the same command with -o better.json writes the model with what is missing"
    elif found["verdict"] == "adequate":
        yield f"youbot evaluate --model {output or model} compares controllers on it"


def _write_law(
    out: Console, path: Path, result: Diagnosis, model: str, output: Path | None
) -> None:
    """Write the proposed law as a file of effects, and say what to do with it."""
    if result.proposal is None:
        out.print(f"no law is proposed: {path} is not written", soft_wrap=True)
        return
    write_text(path, result.proposal.file_text)
    out.print(f"law written to {path}; next:", soft_wrap=True)
    added = f"youbot add {output or model} {result.proposal.name} LOG... --effects {path}"
    out.print(f"  {added} -o NEW_MODEL", soft_wrap=True, highlight=False)


def _print(out: Console, found: dict[str, Any], told_first: int) -> None:
    from youbot_scripts.shared.pages import next_experiment

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
    if found["proposal"]:
        show(out, [result_tables.laws(found["proposal"])])
    out.print(f"Verdict: {found['verdict']}", style="bold")
    out.print(found["headline"])
    for sentence in [*found["words"], *found["changes"]["words"]]:
        out.print(f"- {sentence}")
    if found["proposal"] and not found["proposal"]["file"]:
        out.print(
            "next: the same command with --proposal law.py -o base.json writes this law",
            soft_wrap=True,
        )
    for line in next_experiment(found):
        out.print(line)
    for warning in found["warnings"][told_first:]:
        out.print(f"warning: {warning}", style="yellow")


if __name__ == "__main__":
    sys.exit(run_script(__file__))
