"""The bench's results as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from youbot_env.physics.effect import in_brackets
from youbot_scripts.blind_bench.effects import CATALOGUE
from youbot_scripts.blind_bench.promises import KIND_WORDS, WANTED
from youbot_scripts.blind_bench.scores import (
    named_sets,
    planted,
    right,
    sensing,
    verdict,
)
from youbot_scripts.blind_bench.trials import errors_of
from youbot_scripts.shared.tables import Table, columns, number, show as show_tables, text

if TYPE_CHECKING:
    from rich.console import Console

    from youbot_scripts.blind_bench.trials import Record

SCORE_WORDS = {
    "right": "right",
    "wrongly_named": "named what nobody planted",
    "refused": "refused",
    "crashed": "crashed",
    "identify_failed": "refused by identify, or it crashed",
    "warned": "with a warning of a library",
    "named_exactly": "what is planted named alone, and nothing else",
    "baseline_right": "the baseline: right",
    "baseline_wrongly_named": "the baseline: named what nobody planted",
    "baseline_named_exactly": "the baseline: what is planted named, and nothing else",
    "false_alarm": 'false alarms (anything but "adequate")',
    "in_set": "truth named first, or in its set of three",
    "alone": "truth named alone",
    "confidently_wrong": "a wrong name without alternative",
    "accepted_unplanted": "accepted what nobody planted",
    "both_found": "both found",
    "exactly_both": "both named, and nothing else",
    "coulomb_called_stribeck": "Coulomb called Stribeck",
    "log_named": "named, with its logs",
    "log_told": "named with its logs, or these told as the regime",
    "regime_right": "the regime in the right words",
    "said_unknown": '"unknown", after one partial fit at most',
    "law_proposed": "a law proposed",
    "law_right": "its site and main variable right",
    "law_form": "its form right, or in its set of three",
    "law_helps": "80 % of the way to the true law's velocity error, unseen run",
    "law_needless": "a law proposed that nothing needs",
    "carrier_first_or_second_where": "carrier first or second, base model",
    "carrier_first_or_second_remaining": "carrier first or second, last model",
    "error_fall_of_95": "velocity error falls by 95 % of what it can",
    "sizes_inside": "sizes within their 95 % intervals",
    "sizes_within_3": "sizes within 3 stated deviations",
    "base_stated": "base parameters with an interval",
    "base_inside": "base parameters within their 95 % intervals",
    "base_within_3": "base parameters within 3 stated deviations",
    "base_all_within_3": "cases with all of them within 3",
    "identified_base_inside": "by identify: within their 95 % intervals",
    "identified_base_all_within_3": "by identify: cases with all within 3",
    "tie_resolved": "tie resolved by the proposed experiment",
}

NUMBER_WORDS = {
    "error_fall_median": "fall of the velocity error, median",
    "mean_set_size": "names in a set, on average",
    "explained_share_median": "explained share, median",
    "predictable_share_median": "predictable share, median",
    "seconds_median": "seconds a case, median",
    "seconds_longest": "seconds a case, longest",
}


def show(console: Console, scores: Mapping[str, Any], records: Sequence[Record]) -> None:
    """Print all tables of a bench."""
    show_tables(console, tables(scores))
    for line in [*not_right(records), *(f"error: {line}" for line in errors_of(records))]:
        console.print(line, soft_wrap=True)


def tables(scores: Mapping[str, Any]) -> Iterator[Table]:
    """All tables of a bench."""
    for kind, found in scores["kinds"].items():
        yield from _of_kind(kind, found)
    for kind, table in scores["confusion"].items():
        if kind != "none" and table:
            yield _confusion(kind, table)
    if scores["smallest_detectable_factor"]:
        yield _detectable(scores["smallest_detectable_factor"])


def not_right(records: Sequence[Record]) -> list[str]:
    """A line for each case whose verdict is wrong."""
    wrong = (record for record in records if not right(record) and "error" not in record)
    return [f"not right: {described(record)}" for record in wrong]


def described(record: Record) -> str:
    """A case, what is planted in it and what was said, in a line."""
    case = record["case"]
    how = [*planted(record), *([name] if (name := sensing(record)) else [])]
    names = [" or ".join(names) for names in named_sets(record)]
    said = ", ".join([verdict(record), *names])
    return f"{case['key']} (case {case['index']} of its kind; {'+'.join(how) or 'nothing'}): {said}"


def _of_kind(kind: str, found: Mapping[str, Any]) -> Iterator[Table]:
    rows = [
        (words, *_share_cells(found[key]), WANTED.get((kind, key), ""))
        for key, words in SCORE_WORDS.items()
        if key in found and found[key]["total"]
    ]
    for rate, share in found.get("false_alarm_by_rate", {}).items():
        rows.append((f"  of them at {rate} Hz", *_share_cells(share), ""))
    for key, words in NUMBER_WORDS.items():
        if found.get(key) is not None:
            rows.append((words, number(found[key], 3), "", "", ""))
    said = ", ".join(f"{word} {count}" for word, count in found["verdicts"].items())
    title = f"{KIND_WORDS.get(kind, kind)}: {found['cases']} cases ({said})"
    headers = columns("", "share", "95 % interval", "cases", "wanted")
    yield Table(title, headers, tuple(rows))
    if groups := found.get("right_by_sensing"):
        measured = tuple((name, *_share_cells(share)) for name, share in groups.items())
        headers = columns("", "right", "95 % interval", "cases")
        yield Table("the same cases, by how they are measured", headers, measured)


def _share_cells(share: Mapping[str, Any]) -> tuple[str, str, str]:
    low, high = share["interval"]
    cases = f"{share['count']}/{share['total']}"
    return f"{100 * share['share']:.1f} %", f"{100 * low:.1f} to {100 * high:.1f}", cases


def _confusion(kind: str, table: Mapping[str, Mapping[str, int]]) -> Table:
    rows = [
        (name, sum(row.values()), ", ".join(f"{key} {count}" for key, count in row.items()))
        for name, row in table.items()
    ]
    title = f"{KIND_WORDS.get(kind, kind)}: planted, and what was said"
    headers = columns("planted", "cases", text("said"))
    return Table(title, headers, tuple(rows))


def _detectable(factors: Mapping[str, float | None]) -> Table:
    rows = [
        (
            name,
            "-" if factor is None else f"{factor:g}",
            "-" if factor is None else f"{factor * CATALOGUE[name].size:.3g}",
            CATALOGUE[name].unit,
        )
        for name, factor in factors.items()
    ]
    title = "smallest size that is found in 85 % of the cases, and so is each larger one tried"
    headers = columns("effect", "times its size", "size", "unit")
    return Table(title, headers, tuple(rows))


def show_sizes(console: Console, table: Mapping[str, Mapping[str, Any]]) -> None:
    """Print force error over noise floor by size."""
    factors = list(next(iter(table.values()))["ratio_by_factor"])
    rows = [
        (
            in_brackets(name, item["unit"]),
            f"{item['size']:g}",
            *(f"{item['ratio_by_factor'][factor]:.1f}" for factor in factors),
            number(item["smallest"], 2),
            number(item["largest"], 2),
        )
        for name, item in table.items()
    ]
    headers = columns("effect", "size", *(f"x{factor}" for factor in factors), "3 at", "20 at")
    title = "base model's force error over its noise floor, and sizes at which it is 3 and 20"
    show_tables(console, [Table(title, headers, tuple(rows))])


CLAIM_WORDS = {
    "right": "right",
    "wrongly_named": "named what nobody planted",
    "named_exactly": "what is planted named alone, and nothing else",
    "law_right": "beyond the catalogue: site and a variable right",
    "error_falls": "80 % of the way to the noise, unseen run",
}


def show_claims(out: Console, found: Mapping[str, Any]) -> None:
    """Print the scores of a tool's answers to a blind set, a table for each kind of case."""
    for kind, shares in found.items():
        if kind == "unanswered":
            continue
        rows = tuple(
            (words, f"{shares[key]['count']} of {shares[key]['total']}", _interval(shares[key]))
            for key, words in CLAIM_WORDS.items()
            if shares[key]["total"]
        )
        title = f"{KIND_WORDS.get(kind, kind)}: {shares['cases']} cases"
        show_tables(out, [Table(title, columns("score", "cases", "95 % interval"), rows)])
    if found["unanswered"]:
        out.print(f"{found['unanswered']} cases have no answer, and count as wrong")


def _interval(share: Mapping[str, Any]) -> str:
    low, high = share["interval"]
    return f"{100 * low:.0f} to {100 * high:.0f} %"
