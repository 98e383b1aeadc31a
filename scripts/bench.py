"""Test the diagnosis on blind cases from a simulator of its own."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from youbot_env.errors import InputError
from youbot_scripts.blind_bench.baseline import stepwise
from youbot_scripts.blind_bench.calibration import rows_of
from youbot_scripts.blind_bench.calibration_page import Run, made_by, write_page
from youbot_scripts.blind_bench.cases import KINDS, write_case
from youbot_scripts.blind_bench.effect_sizes import force_ratio, size_table, sizings
from youbot_scripts.blind_bench.null_fits import null_fits, null_p_values
from youbot_scripts.blind_bench.published import Published
from youbot_scripts.blind_bench.publishing import publish as write_blind_set
from youbot_scripts.blind_bench.report import not_right, show, show_claims, show_sizes, tables
from youbot_scripts.blind_bench.scores import score
from youbot_scripts.blind_bench.trials import Options, Record, Spec, plan, run_trials
from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.workers import spread

EXAMPLES = (
    "youbot bench --cases 200 --kinds none --resume bench/",
    "youbot bench --cases 60 --kinds one,quarter,two,unknown --jobs 2 --resume bench/",
    "youbot bench --cases 30 --kinds noise,counts,double_noise --jobs 2 --resume bench/",
    "youbot bench --kinds noise --first 7 --cases 1 --jobs 1 --keep cases/",
    "youbot bench --cases 20 --kinds none,one,two --report bench.html",
    "youbot bench --cases 105 --kinds sweep",
    "youbot bench --cases 3 --kinds floor_tilt --write cases/",
    "youbot bench --cases 300 --kinds fleet --write robots/",
    "youbot bench --calibration docs/calibration.md --kinds none,noise,one,two --cases 50 "
    "--replicates 2000 --ranked 400 --seed 11 --resume calibration/",
    "youbot bench --sizes --cases 2",
    "youbot bench --publish blind/ --kinds none,one,law --cases 20 --seed 7",
    "youbot bench --publish blind/ --tool stepwise --jobs 2",
    "youbot bench --publish blind/ --score mine/answers.json",
)

TOOL_NAMES = "youbot, stepwise, sparse, boosted"

DEFAULT_KINDS = "none,one,quarter,two,unknown"


def main(
    cases: Annotated[
        int, typer.Option(min=1, max=100_000, metavar="N", help="Cases of each kind.")
    ] = 15,
    kinds: Annotated[
        str,
        typer.Option(metavar="A,B,...", help=f"Of {', '.join(KINDS)}, or an effect or noise."),
    ] = DEFAULT_KINDS,
    rates: Annotated[
        str,
        typer.Option(
            metavar="HZ,...", help="Log rates; default 100 Hz, and 50, 100, 250 for none."
        ),
    ] = "",
    noise: Annotated[
        float | None,
        typer.Option(min=0.0, help="Noise, times 0.03 N m and 0.01 rad/s; default: by kind."),
    ] = None,
    jobs: common.JobsOption = 2,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep each trial here, and do not do again those here."),
    ] = None,
    first: Annotated[
        int, typer.Option(min=0, metavar="N", help="Index of each kind's first case.")
    ] = 0,
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Keep each case here: logs, truth.json, trial.json, a folder each."
        ),
    ] = None,
    limit: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Give a case up after so long; 0: never.")
    ] = 0.0,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Only write the cases: logs and truth.json, a folder each."
        ),
    ] = None,
    follow_up: Annotated[
        bool,
        typer.Option("--follow-up", help="Record what is proposed for a tie, and diagnose again."),
    ] = False,
    baseline: Annotated[
        bool,
        typer.Option("--baseline", help="Beside it stepwise F-tests on a split sample, with FDR."),
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="PAGE.md", help="Write what every stated probability delivers to a page."
        ),
    ] = None,
    replicates: Annotated[
        int, typer.Option(min=0, metavar="N", help="Fits without a diagnosis, for that page.")
    ] = 0,
    ranked: Annotated[
        int, typer.Option(min=0, metavar="N", help="Of the platforms of these fits, with p-values.")
    ] = 0,
    publish: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write a blind set: logs, and apart from them the answers."
        ),
    ] = None,
    tool: Annotated[
        str,
        typer.Option(metavar="NAME", help=f"Let it answer the set in --publish: {TOOL_NAMES}."),
    ] = "",
    score_file: Annotated[
        Path | None,
        typer.Option("--score", metavar="FILE", help="Score answers to the set in --publish."),
    ] = None,
    sizes: Annotated[
        bool, typer.Option("--sizes", help="Only measure how large each effect must be to matter.")
    ] = False,
    report: common.ReportOption = None,
    seed: common.SeedOption = 0,
    json: common.JsonOption = None,
) -> None:
    """Test the diagnosis on blind cases: random platforms with something planted.

    Cases come from a simulator of its own, which shares no line with the models that are fitted;
    they look like logs of the stock loop on the calibration motions and two multisines. Kinds:
    none (nothing planted), noise (nothing, under noise that is not white), counts (speeds from
    encoder counts, with Coulomb friction in every other case), one (an effect of about catalogue
    size), quarter (a quarter of it under twice the noise), double_noise (its size under twice the
    noise), two (two effects), unknown (something outside the catalogue), sweep (each effect at 1/16
    to 4 times its size), fleet (a robot each, one in ten with an effect). Each case is identified,
    and diagnosed from the published model, whose parameters are not the platform's. The same kind,
    index, seed, rate and noise make the same case: `--first N --cases 1` runs one alone. Cases that
    --resume finds are neither run nor kept. --calibration writes a page of what all stated
    probabilities promise and deliver on these cases, on --replicates fits of platforms to which
    nothing is added, white noise and other in turn, and on the p-values of --ranked of them.

    --publish writes the cases as a blind set for other tools, with the rules in its README.md;
    --score scores a tool's answers to it, --tool answers it by this diagnosis or by a baseline of
    the literature, and scores that.
    """
    out = common.console(json)
    common.check_pictures(None, report)
    if sizes:
        _measure_sizes(out, cases, seed, jobs, json)
        return
    if publish is not None and (tool or score_file):
        _try_tool(publish, tool, score_file, seed, jobs, json, out)
        return
    if tool or score_file:
        raise InputError("--tool and --score need the blind set: --publish DIR")
    specs = plan(_words(kinds), cases, seed, _rates(rates), noise, first)
    if publish is not None:
        with common.progress(len(specs), "publishing") as advance:
            write_blind_set(specs, publish, jobs=jobs, progress=advance)
        out.print(f"{len(specs)} cases: {publish}", soft_wrap=True)
        return
    if write is not None:
        _write(specs, write, out)
        return
    records = bench(
        specs,
        jobs=jobs,
        folder=resume,
        options=Options(follow_up=follow_up, keep=keep, limit=limit),
        baseline=baseline,
    )
    scores = score(records)
    if calibration is not None:
        fits = null_fits(replicates, seed, jobs, resume)
        p_values = null_p_values(ranked, seed, jobs, resume)
        made = made_by([*fits, *p_values, *records])
        run = Run(len(fits), len(p_values), len(records), cases, seed, made)
        write_page(calibration, rows_of(records, fits, p_values), run)
        out.print(f"calibration: {calibration}", soft_wrap=True)
    show(out, scores, records)
    if report:
        from youbot_scripts.blind_bench.charts import write_report

        write_report(report, records, tables(scores), not_right(records), seed)
        out.print(f"report written to {report}", soft_wrap=True)
    common.write_result(json, {**scores, "trials": records}, seed)


def bench(
    specs: list[Spec],
    *,
    jobs: int = 1,
    folder: Path | None = None,
    options: Options,
    baseline: bool = False,
) -> list[Record]:
    """Identify and diagnose the cases, with a progress bar."""
    from identification.diagnosis.diagnose import diagnose
    from identification.fitting.identify import identify

    # The course of the estimates over time is not scored.
    options = replace(options, identify=partial(identify, recursive=False))
    if baseline:
        options = replace(options, baseline=stepwise)
    with common.progress(len(specs), "diagnosing") as advance:
        return run_trials(
            specs, diagnose, jobs=jobs, folder=folder, options=options, progress=advance
        )


def _try_tool(
    folder: Path, tool: str, answers: Path | None, seed: int, jobs: int, json: Path | None, out: Any
) -> None:
    """Let a tool answer a blind set, and score answers to it."""
    from youbot_scripts.blind_bench.claim_scores import score_claims

    published = Published(folder)
    codes = published.codes
    if tool:
        from youbot_scripts.blind_bench.tools import answer_set

        with common.progress(len(codes), tool) as advance:
            path = answer_set(published, tool, seed=seed, jobs=jobs, progress=advance)
        out.print(f"answers: {path}", soft_wrap=True)
        answers = answers or path
    assert answers is not None
    found = score_claims(published, answers)
    show_claims(out, found)
    common.write_result(json, found, seed)


def _words(text: str) -> list[str]:
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words:
        raise InputError(f"kinds: none is named; use {DEFAULT_KINDS}")
    return words


def _rates(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",") if word.strip()]
    except ValueError:
        raise InputError(
            f"rates: {text!r} is no list of numbers; write for instance 50,100"
        ) from None


def _write(specs: list[Spec], folder: Path, out: Any) -> None:
    with common.progress(len(specs), "writing") as advance:
        for spec in specs:
            case = spec.draw()
            write_case(folder / case.key, case)
            advance()
    out.print(f"{len(specs)} cases: {folder}", soft_wrap=True)


def _measure_sizes(out: Any, cases: int, seed: int, jobs: int, json: Path | None) -> None:
    wanted = sizings(cases, seed)
    found = []
    with common.progress(len(wanted), "measuring") as advance:
        for row in spread(force_ratio, wanted, jobs):
            found.append(row)
            advance()
    table = size_table(found)
    show_sizes(out, table)
    common.write_result(json, {"sizes": table}, seed)


if __name__ == "__main__":
    sys.exit(run_script(__file__))
