"""Many blind trials: planned, spread over processes, kept as they are done, and taken up again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path

from youbot_scripts.blind.cases import Case, draw_case
from youbot_scripts.blind.effects import CATALOGUE
from youbot_scripts.blind.trial import Diagnose, Record, run_trial
from youbot_scripts.journal import resumed


@dataclass(frozen=True)
class Spec:
    """What makes a case: see :func:`youbot_scripts.blind.cases.draw_case`."""

    kind: str
    index: int
    seed: int
    rate: float | None = None
    noise: float | None = None

    def draw(self) -> Case:
        """The case."""
        return draw_case(self.kind, self.index, self.seed, self.rate, self.noise)


def plan(
    kinds: Sequence[str],
    cases: int,
    seed: int,
    rates: Sequence[float] = (),
    noise: float | None = None,
) -> list[Spec]:
    """``cases`` cases of each kind, the kinds in turn, so that a part of them is a fair sample.

    Parameters
    ----------
    rates : of the logs [Hz], in turn; empty: as each kind has it
    noise : factor on the base noise; None: as each kind has it

    Raises
    ------
    InputError
        If a kind or rate cannot be.
    """
    columns = []
    for kind in kinds:
        # A full turn through the effects before the next rate, so that each meets each.
        turn = len(CATALOGUE) if kind in ("one", "quarter", "sweep") else 1
        columns.append(
            [
                Spec(kind, i, seed, rates[i // turn % len(rates)] if rates else None, noise)
                for i in range(cases)
            ]
        )
        if cases:
            columns[-1][0].draw()
    return [spec for spec in chain.from_iterable(zip_longest(*columns)) if spec is not None]


def try_case(diagnose: Diagnose, follow_up: bool, spec: Spec) -> Record:
    """One trial; a crash becomes part of the record, so that it does not end the others."""
    case = spec.draw()
    try:
        return run_trial(case, diagnose, follow_up)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return {"case": case.to_dict(), "carriers": [], "seconds": 0.0, "error": message}


def run_trials(
    specs: Sequence[Spec],
    diagnose: Diagnose,
    *,
    jobs: int = 1,
    folder: Path | None = None,
    follow_up: bool = False,
    progress: Callable[[], None] = lambda: None,
) -> list[Record]:
    """Trials of all cases, in their order.

    Parameters
    ----------
    diagnose : ``diagnose(model, logs, seed=...)``; picklable if ``jobs`` is more than one
    follow_up : record the experiment that is proposed for a tie, and diagnose again
    folder : where each trial is noted as it is done; those that are there are not done again

    Raises
    ------
    InputError
        If the folder cannot be made or holds something else.
    """
    keys = {spec: spec.draw().key for spec in specs}
    done = resumed(
        partial(try_case, diagnose, follow_up),
        {key: spec for spec, key in keys.items()},
        lambda record: record["case"]["key"],
        jobs=jobs,
        folder=folder,
        progress=progress,
    )
    return [done[keys[spec]] for spec in specs]


def errors_of(records: Iterable[Record]) -> list[str]:
    """What went wrong, by case."""
    return [f"{r['case']['key']}: {r['error']}" for r in records if "error" in r]
