"""What the stated probabilities promise and deliver, on cheap fits and on the bench's cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from youbot_scripts.blind_bench.promises import NULLS, Row as Row
from youbot_scripts.blind_bench.scores import (
    INTERVAL,
    base_off,
    identified_base_off,
    named_sets,
    of_baseline,
    planted,
    sizes_off,
    verdict,
    wrongly_named,
)
from youbot_scripts.blind_bench.sensors import NOISES
from youbot_scripts.blind_bench.trials import Record

LEVELS = (0.01, 0.05, 0.2)
"""Levels at which p-values are judged; an effect is accepted below the first."""


Answers = Iterable[Sequence[bool]]
"""Per replicate, whether each thing that it stated held."""


def row_of(
    what: str, promised: str, answers: Answers, least: float = 0.0, most: float = 1.0
) -> Row | None:
    """A row; None where nothing was stated."""
    listed = [list(one) for one in answers]
    if not any(listed):
        return None
    hits, of = (tuple(map(count, listed)) for count in (sum, len))
    return Row(what, promised, hits, of, least, most)


def rows_of(
    records: Sequence[Record], fits: Sequence[Record], ranked: Sequence[Record]
) -> dict[str, list[Row]]:
    """All rows, by heading.

    records : trials of the bench; fits : of platforms to which nothing is added; ranked : p-values
        of such platforms
    """
    trials = {kind: [r for r in records if r["case"]["kind"] == kind] for kind in TRIALS}
    null, p_values = (
        {
            kind: [r for r in some if r["case"]["kind"] == kind and "error" not in r]
            for kind in NULLS
        }
        for some in (fits, ranked)
    )
    tables = {
        "Intervals of 95 %": _intervals(trials, null),
        "p-values where nothing is missing": _p_values(p_values),
        "p-values by kind of noise": _p_values_by_noise(p_values["noise"]),
        "Verdicts": _verdicts(trials, null),
    }
    return {heading: [row for row in rows if row is not None] for heading, rows in tables.items()}


TRIALS = {
    "none": "nothing missing, white noise",
    "noise": "nothing missing, other noise",
    "one": "one effect",
    "two": "two effects",
}
"""Kinds of the bench that a page tells of."""

NOISE = {"none": "white noise", "noise": "other noise"}

INTERVAL_HOLDS = ("95 %", 0.93, 0.97)
"""What is promised of an interval, and the shares that keep it."""


def _inside(offs: Iterable[float | None]) -> list[bool]:
    return [off <= INTERVAL for off in offs if off is not None]


def _intervals(trials: dict[str, list[Record]], null: dict[str, list[Record]]) -> list[Row | None]:
    promised, *bounds = INTERVAL_HOLDS
    found = [
        row_of(
            f"base parameters by `identify`, calibration motion alone, {NOISE[kind]}",
            promised,
            (_inside(base_off(record).values()) for record in rows),
            *bounds,
        )
        for kind, rows in null.items()
    ]
    of_trials: list[tuple[str, Callable[[Record], list[bool]]]] = [
        ("base parameters by `identify`", lambda r: _inside(identified_base_off(r).values())),
        ("base parameters by `diagnose`", lambda r: _inside(base_off(r).values())),
        ("sizes of effects", lambda r: _inside(sizes_off(r))),
    ]
    for what, inside in of_trials:
        for kind, rows in trials.items():
            if what.endswith("`identify`") and kind not in NULLS:
                continue  # where something is missing it states no interval
            found.append(row_of(f"{what}, {TRIALS[kind]}", promised, map(inside, rows), *bounds))
    return found


def _p_values(ranked: dict[str, list[Record]]) -> list[Row | None]:
    other = ranked["noise"]
    groups = {
        "white noise": ranked["none"],
        "other noise": [r for r in other if _noise_of(r) not in OFFSETS],
        OFFSET: [r for r in other if _noise_of(r) in OFFSETS],
    }
    found = []
    for key, what in (("p_value", "candidates"), ("map_p_value", "the map's variables")):
        for noise, rows in groups.items():
            for level in LEVELS:
                below = map(partial(_is_below, key, level), rows)
                name = f"least p-value of all {what} is {level:g} or less, {noise}"
                found.append(_alarms(name, f"{level:.0%}", below, level, noise == OFFSET))
    # A variable is told only if its p-value is small and it has a material share as well.
    for noise, rows in groups.items():
        told = ([bool(record["leading"])] for record in rows)
        name = f"the map tells a variable that the error depends on, {noise}"
        found.append(_alarms(name, f"at most {LEVELS[1]:.0%}", told, LEVELS[1], noise == OFFSET))
    return found


def _alarms(
    what: str, promised: str, told: Iterable[Sequence[bool]], most: float, there: bool
) -> Row | None:
    """A row of what is told of logs; where it is ``there``, any share of them keeps the promise."""
    if there:
        return row_of(what, "that is there", told, 0.0, 1.0)
    return row_of(what, promised, told, 0.0, most)


def _noise_of(record: Record) -> str | None:
    """Kind of a replicate's noise; None if it is white."""
    sensing = record["case"]["sensing"]
    return sensing and sensing["name"]


def _p_values_by_noise(rows: Sequence[Record]) -> list[Row | None]:
    level = LEVELS[1]
    below = partial(_is_below, "p_value", level)
    return [
        _alarms(
            f"least p-value of all candidates is {level:g} or less, {name.replace('_', ' ')}",
            f"{level:.0%}",
            (below(record) for record in rows if _noise_of(record) == name),
            level,
            name in OFFSETS,
        )
        for name in NOISES
    ]


OFFSET = "noise that leaves an offset"

OFFSETS = ("torque_wander", "offset_wander", "outliers")
"""Noises that leave an offset of a torque channel in a log, or in a part of it: they wander for
seconds to minutes, or are outliers to one side. A small p-value is no false alarm there."""


def _is_below(key: str, level: float, record: Record) -> list[bool]:
    return [record[key] <= level]


def _verdicts(trials: dict[str, list[Record]], null: dict[str, list[Record]]) -> list[Row | None]:
    found = [
        row_of(
            f"`identify` says that something is missing, where nothing is, {NOISE[kind]}",
            "at most 1 %" if kind == "none" else "at most 5 %",
            ([record["misfit"]] for record in rows),
            most=0.01 if kind == "none" else 0.05,
        )
        for kind, rows in null.items()
    ]
    for kind, least in (("none", 0.99), ("noise", 0.95)):
        adequate = ([verdict(r) == "adequate"] for r in trials[kind])
        what = f'verdict "adequate", {TRIALS[kind]}'
        found.append(row_of(what, f"at least {least:.0%}", adequate, least))
    for kind, rows in trials.items():
        wrong = ([wrongly_named(r)] for r in rows)
        found.append(
            row_of(f"a name that nobody planted, {TRIALS[kind]}", "at most 2 %", wrong, most=0.02)
        )
    found.append(
        row_of(
            "a set of several names, in place of one: the planted one is in it",
            "95 %",
            map(_truth_in_sets, [*trials["one"], *trials["two"]]),
            0.93,
        )
    )
    found += [
        row_of(
            f"the baseline: a name that nobody planted, {TRIALS[kind]}",
            "5 % of the names",
            ([wrongly_named(other)] for r in rows if (other := of_baseline(r)) is not None),
            most=0.05,
        )
        for kind, rows in trials.items()
    ]
    return found


def _truth_in_sets(record: Record) -> list[bool]:
    sets = [set(names) for names in named_sets(record) if len(names) > 1]
    return [bool(names & set(planted(record))) for names in sets]
