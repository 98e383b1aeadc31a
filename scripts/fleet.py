"""Diagnose many robots, a folder of logs each, on many machines."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import show

EXAMPLES = (
    "youbot fleet diagnose paper robots/ -o fleet/ --report fleet.html",
    "youbot fleet diagnose model.json site_a/* site_b/* -o fleet/ --backend ray --jobs 8",
)


class Action(StrEnum):
    """What is done with a fleet."""

    DIAGNOSE = "diagnose"


class Backend(StrEnum):
    """Where the workers are."""

    LOKY = "loky"
    RAY = "ray"
    DASK = "dask"


def main(
    action: Annotated[Action, typer.Argument(metavar="diagnose", help="What to do.")],
    model: common.ModelArgument,
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER...",
            help="A folder of logs for each robot, or folders that hold such folders.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Results and models; resumed if there."),
    ],
    backend: Annotated[
        Backend,
        typer.Option(
            metavar="NAME", help="loky: processes here; ray, dask: a cluster (extras ray, dask)."
        ),
    ] = Backend.LOKY,
    jobs: common.JobsOption = 2,
    audit: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            metavar="SHARE",
            help="Of the robots diagnosed in full whatever the screen says; 1: all.",
        ),
    ] = 0.05,
    effects: common.EffectsOption = None,
    report: common.ReportOption = None,
    json: common.JsonOption = None,
    seed: common.SeedOption = 0,
) -> None:
    """Say which effects are missing in which robots of a fleet.

    Each robot's logs are fitted first; where that leaves nothing that the motion predicts the
    robot counts as adequate, and else it is diagnosed. --audit diagnoses some of the others too,
    and counts what the fit had missed. DIR gets robots/NAME.json and models/NAME.json as each
    robot is finished: a run that was stopped, even killed, goes on where it was. At the end
    DIR/fleet.jsonl holds a line for each robot, the same to the bit whatever the backend. Over the
    fleet: effects at a false discovery rate of 1 %, parameters far from the others', logs that
    could not be read. RAY_ADDRESS and DASK_SCHEDULER_ADDRESS name a cluster, whose machines see
    the same folders.
    """
    # Imported here: `youbot fleet --help` does without numpy and scipy.
    from youbot_scripts.fleets.diagnosing import diagnose_robot
    from youbot_scripts.fleets.fleet import diagnose_fleet
    from youbot_scripts.fleets.page import cost_lines, headline, screen_lines, tables, write_report
    from youbot_scripts.fleets.robots import robots_of
    from youbot_scripts.shared.workers import on_backend

    common.check_pictures(None, report)
    robots, out = robots_of(folders), common.console(json)
    with on_backend(backend.value, jobs), common.progress(len(robots), "diagnosing") as advance:
        result = diagnose_fleet(
            *(diagnose_robot, model, robots, output),
            jobs=jobs,
            audit=audit,
            effects=effects,
            seed=seed,
            progress=advance,
        )
    show(out, tables(result.summary, most=SHOWN))
    for line in (
        headline(result.summary), *screen_lines(result.summary), *cost_lines(result.cost)
    ):  # fmt: skip
        out.print(line)
    out.print(f"results: {result.lines}", soft_wrap=True)
    found = {**result.summary.to_dict(), "cost": result.cost.to_dict()}
    common.write_result(json, found, seed)
    if report:
        write_report(report, model, result.records, result.summary, result.cost, seed)
        out.print(f"report written to {report}", soft_wrap=True)


SHOWN = 12
"""Rows of each list in the terminal; page and JSON hold all."""


if __name__ == "__main__":
    sys.exit(run_script(__file__))
