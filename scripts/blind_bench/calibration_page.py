"""The page of what was promised and what was delivered, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from youbot_env.files import write_atomically
from youbot_scripts.blind_bench.promises import Row
from youbot_scripts.shared.results_folder import Record

COMMAND = (
    "youbot bench --calibration docs/calibration.md --kinds none,noise,one,two --cases 50 \\\n"
    "    --replicates 2000 --ranked 400 --seed 11 --resume calibration/"
)

INTRODUCTION = """# What the stated probabilities deliver

Everything here comes from platforms of a second simulator, which shares no line with the models
that are fitted. One command makes this page anew, and goes on where it was stopped:

<!-- not run: takes hours -->
```bash
{command}
```

A *fit* is of a platform's calibration motion alone, 140 s, to which nothing is added; p-values are
taken of some of these platforms (`--ranked`). A *diagnosis* has 260 s of logs and is what
`youbot bench` runs. Several numbers of one replicate are not independent: standard errors are those
of a ratio over replicates. **short**: outside the promise by more than two of them. Other noise:
ten kinds, from AR(1) to hum, outliers, coarse steps and offsets that wander. With `--baseline` a
stepwise selection by F-tests on a split sample, with the false discovery rate of Benjamini and
Hochberg, answers the same cases; the [blind set](blind_set.md) has its score on 200 of them.

{made_by}. {fits} fits, p-values of {ranked}, {trials} diagnoses:
`--cases {cases} --replicates {fits} --ranked {ranked} --seed {seed}`.
"""


NOTES = {
    "p-values by kind of noise": """\
Random signs of blocks of 2 s tell chance from a cause where noise is forgotten within a block.
Torques that wander for longer, and outliers that are all to one side, leave an offset of the
channel in the log, or in a part of it. A small p-value is right there, of `torque_offset` and of
others that a constant torque looks like: a slope, a spring, a friction that is larger forwards.
The table above tells of these three kinds of noise in rows of their own.
Noise of speeds that is not white (AR(1), hum) is in the acceleration, and so in the residual and in
the columns of effects of the drives, of `drive_resonance` most. It is taken off with the spectrum
that the speeds of a platform show beside any rigid motion. It is in the model's own columns too and
makes its masses too small, which the columns of a lag or a delay show: that is taken off as well.
Steps of coarse speeds are no such noise: `drive_resonance` may have a small p-value there.
Noise of torques that is not white is in the columns of effects that bend the torque, of `dead_zone`
most. It is taken off with the spectrum that the residual holds beside the speeds' noise.
No verdict rests on a p-value alone: an effect must take away a share of what can be predicted on
held-out stretches, and of noise nothing can.

"""
}
"""What a reader must know of a table."""


Tables = Mapping[str, Sequence[Row]]
"""Rows by heading."""


class Run(NamedTuple):
    """What a page comes from: so many fits, rankings, trials, cases of each kind; their seed; and
    the commits that made them, see ``made_by``."""

    fits: int
    ranked: int
    trials: int
    cases: int
    seed: int
    made_by: str


def write_page(path: Path, tables: Tables, run: Run) -> None:
    """Write the page of a run.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, page(tables, run))


def page(tables: Tables, run: Run) -> str:
    """The page's text."""
    told = INTRODUCTION.format(command=COMMAND, **run._asdict())
    for heading, rows in tables.items():
        if rows:
            told += f"\n## {heading}\n\n" + NOTES.get(heading, "") + _table(rows)
    return told


def _table(rows: Sequence[Row]) -> str:
    lines = [
        "| what is stated | promised | delivered | standard error | replicates | |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        mark = "**short**" if row.falls_short else ""
        numbers = f"{row.share:.1%} | {row.std:.1%} | {row.replicates}"
        lines.append(f"| {row.what} | {row.promised} | {numbers} | {mark} |")
    return "\n".join(lines) + "\n"


def made_by(records: Iterable[Record]) -> str:
    """Which commits made records: a run that was stopped and went on may have several."""
    counts = Counter(record.get("commit", "not recorded") for record in records)
    if len(counts) == 1:
        return f"Commit {next(iter(counts))}"
    parts = (f"{name} ({count} results)" for name, count in counts.most_common())
    return f"Commits {', '.join(parts)}"
