"""Measure the simulator's speed beside Gymnasium's own."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from youbot_scripts.cli import run_script
from youbot_scripts.shared import options as common
from youbot_scripts.shared.tables import show

EXAMPLES = (
    "youbot benchmark",
    "youbot benchmark --copies 1024,8192,1048576 --json speed.json",
    "youbot benchmark --quick --report speed.html",
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
    quick: Annotated[bool, typer.Option("--quick", help="Few, short turns; no imports.")] = False,
    report: common.ReportOption = None,
    json: common.JsonOption = None,
) -> None:
    """Env steps a second: one environment beside CartPole-v1, batches beside its vector form.

    Ours and the peer take turns, so that a busy machine slows both; the ratio is the median over
    turns. Batches have noise, one sample of delay, a new reference and a new model in each episode,
    and begin episodes by themselves.
    """
    from youbot_env.threads import threads as usual
    from youbot_scripts.benchmarks.charts import import_table, speed_table, write_report
    from youbot_scripts.benchmarks.speed import (
        EFFECTS,
        SpeedSettings,
        import_times,
        machine,
        speeds,
    )

    common.check_pictures(None, report)
    out = common.console(json)
    settings = SpeedSettings(rounds=3, steps=2000, warm_up=2) if quick else SpeedSettings()
    many = _counts("threads", threads or ("1" if usual() == 1 else f"1,{usual()}"), 1, 1024)
    found = speeds(
        _counts("copies", copies, 1, 2**24),
        many,
        _counts("effects", effects, 0, len(EFFECTS)),
        settings,
    )
    imports = {} if quick else import_times(("youbot_env", "identification", "controllers"))
    show(out, [speed_table(found), *([import_table(imports)] if imports else [])])
    if report:
        write_report(report, found, imports, machine())
        out.print(f"report written to {report}", soft_wrap=True)
    common.write_result(
        json,
        {
            "speeds": [row.to_dict() for row in found],
            "import_seconds": imports,
            "machine": machine(),
        },
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
