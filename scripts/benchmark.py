"""Measure speed beside peers: simulator, logs, training."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common

if TYPE_CHECKING:
    from youbot_scripts.benchmarks.benchmark import Sizes

EXAMPLES = (
    "youbot benchmark",
    "youbot benchmark --copies 1024,8192,1048576 --parts steps --json speed.json",
    "youbot benchmark --quick --plots plots/",
)


def main(
    copies: Annotated[
        str, typer.Option(metavar="N,...", help="Copies side by side.")
    ] = "1,64,1024,8192,65536",
    threads: Annotated[
        str | None, typer.Option(metavar="N,...", help="Threads; default: 1 and a thread a core.")
    ] = None,
    effects: Annotated[
        str, typer.Option(metavar="N,...", help="Effects in the model, 0 to 6.")
    ] = "1,6",
    parts: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...", help="Of steps, simulators, logs, training, imports; default: all."
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few, short turns; no imports.")] = False,
    plots: common.PlotsOption = None,
    report: common.ReportOption = None,
    json: common.JsonOption = None,
) -> None:
    """Speed beside peers: environments, simulators, identification by log length, imports.

    Ours and the peer take turns, so that a busy machine slows both; the ratio is the median over
    turns. Batches have noise, one sample of delay, a new reference and a new model in each episode,
    and begin episodes by themselves. docs/speed.md explains the tables.
    """
    from youbot_scripts.benchmarks.benchmark import draw, measure, tables
    from youbot_scripts.benchmarks.charts import write_report
    from youbot_scripts.shared.tables import show

    common.check_pictures(plots, report)
    out = common.console(json)
    found = measure(_sizes(copies, threads, effects, parts, quick))
    show(out, tables(found))
    if plots:
        for path in draw(found, plots):
            out.print(f"figure: {path}", soft_wrap=True)
    if report:
        write_report(report, found.speeds, tables(found), found.machine)
        out.print(f"report written to {report}", soft_wrap=True)
    common.write_result(json, found.to_dict())


def _sizes(copies: str, threads: str | None, effects: str, parts: str | None, quick: bool) -> Sizes:
    from youbot_env.errors import InputError
    from youbot_env.threads import threads as usual
    from youbot_scripts.benchmarks.benchmark import PARTS, Sizes, usual_parts
    from youbot_scripts.benchmarks.speed import EFFECTS

    chosen = tuple(parts.split(",")) if parts else usual_parts(quick)
    for name in chosen:
        if name not in PARTS:
            raise InputError(f"parts: {name!r} is none of {', '.join(PARTS)}")
    many = threads or ("1" if usual() == 1 else f"1,{usual()}")
    return Sizes(
        parts=chosen,
        copies=_counts("copies", copies, 1, 2**24),
        threads=_counts("threads", many, 1, 1024),
        effects=_counts("effects", effects, 0, len(EFFECTS)),
        quick=quick,
    )


def _counts(name: str, text: str, least: int, most: int) -> list[int]:
    from youbot_env.errors import InputError

    counts = []
    for word in text.split(","):
        if not (word.strip().isascii() and word.strip().isdigit()):
            raise InputError(f"{name}: {word.strip()!r} is not a whole number")
        if not least <= int(word) <= most:
            raise InputError(f"{name}: {int(word)} is outside {least} to {most}")
        counts.append(int(word))
    return counts


if __name__ == "__main__":
    sys.exit(run_script(__file__))
