"""Scores of blind trials: how often the right effect was named, and how certainly."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from statistics import fmean, median
from typing import Any

from youbot_scripts.blind_bench import sensors
from youbot_scripts.blind_bench.draws import WHEELS
from youbot_scripts.blind_bench.effects import CATALOGUE, EVERYTHING, FORMS, KINEMATICS, LAWS
from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.blind_bench.sensors import ENCODER
from youbot_scripts.blind_bench.trials import Record

LARGEST_SET = 3
"""Largest ambiguity set that counts as an answer."""

DETECTED = 0.85
"""Share of cases in which an effect must be found to count as detectable."""

CLEAR = 1.5
"""Least squared velocity error of the base model over the truth's for which its fall is judged."""

INTERVAL = 1.96
"""Standard deviations either side of a stated size."""

BOUND = 3.0
"""Standard deviations beyond which a stated number is plainly wrong."""

TWIST = "twist"

UNNAMED = frozenset(LAWS)
"""What no effect of the catalogue explains."""


# --- one record ------------------------------------------------------------------------------


def planted(record: Record) -> list[str]:
    """Names of what the case plants."""
    return [item["name"] for item in record["case"]["planted"]]


def named_sets(record: Record) -> list[list[str]]:
    """For each accepted effect, its name and what the data cannot tell from it."""
    found = record.get("found", {})
    ties = found.get("ambiguous_with", {})
    return [[name, *ties.get(name, [])] for name in found.get("missing", [])]


def verdict(record: Record) -> str:
    """The verdict, or "error" where there is none."""
    return record.get("found", {}).get("verdict", "error")


def answer(record: Record) -> str:
    """The verdict in a word: first accepted effect, "adequate", "unknown" or "error"."""
    said = verdict(record)
    if said in ("adequate", "unknown", "error"):
        return said
    names = record["found"]["missing"]
    return names[0] if names else said


def _holds(names: Sequence[str], name: str) -> bool:
    return name == names[0] or (name in names and len(names) <= LARGEST_SET)


def in_set(record: Record, name: str) -> bool:
    """Whether an effect was accepted first or lies in a set of at most three that was."""
    return any(_holds(names, name) for names in named_sets(record)[:1])


def found_anywhere(record: Record, name: str) -> bool:
    """The same for any accepted effect, not only the first."""
    return any(_holds(names, name) for names in named_sets(record))


def alone(record: Record) -> bool:
    """Whether exactly the planted effects were named, without alternatives."""
    names = [name for names in named_sets(record) for name in names]
    return verdict(record) == "effect" and sorted(names) == sorted(planted(record))


def confidently_wrong(record: Record) -> bool:
    """Whether the first effect named is wrong, has no alternatives and is not called partial."""
    names = named_sets(record)
    if not names or verdict(record) == "unknown":
        return False
    return len(names[0]) == 1 and names[0][0] not in planted(record)


def accepted_unplanted(record: Record) -> bool:
    """Whether an effect was accepted in whose ambiguity set no planted effect is."""
    return any(not set(names) & set(planted(record)) for names in named_sets(record))


def log_named(record: Record) -> bool | None:
    """Whether what acts in some logs only was named with these; None where nothing does so."""
    wanted = {item["name"]: list(item.get("logs", ())) for item in record["case"]["planted"]}
    wanted = {name: logs for name, logs in wanted.items() if logs}
    if not wanted:
        return None
    found = record.get("found", {})
    said = {key: sorted(logs) for key, logs in found.get("logs", {}).items()}
    # A rival that these logs cannot tell from it is accepted in its place, in the same logs.
    return all(
        any(name in names and said.get(names[0]) == sorted(logs) for names in named_sets(record))
        for name, logs in wanted.items()
    )


def log_told(record: Record) -> bool | None:
    """The same, or the log told as the regime of what remains."""
    named = log_named(record)
    if named is None or named:
        return named
    logs = {log for item in record["case"]["planted"] for log in item.get("logs", ())}
    rule = record.get("found", {}).get("regime") or ""
    return any(log in rule for log in logs)


def regime_right(record: Record) -> bool | None:
    """Whether the rule for where the rest lives is that of what was planted; None without one."""
    rule = record.get("found", {}).get("regime") or ""
    for item in record["case"]["planted"]:
        values = item["values"]
        if item["name"] == "one_way_friction":
            wheel = WHEELS[int(values["wheel"])]
            return rule.startswith(f"velocity_{wheel} {'>' if values['sign'] > 0 else '<'}")
        if item["name"] == "late_drag":
            said = [float(word) for word in rule.split() if word.replace(".", "").isdigit()]
            near = bool(said) and abs(said[0] - values["time"]) < LATE_BY
            return rule.startswith("after") and near
        if item["name"] in ("sticky_patch", "bump"):
            return "pose_" in rule
    return None


LATE_BY = 6.0
"""[s] by which the instant in a rule may be off: a stretch that is held out together."""


def said_unknown(record: Record) -> bool:
    """Whether the verdict is "unknown" after one partial fit at most."""
    return verdict(record) == "unknown" and len(named_sets(record)) <= 1


def carrier_rank(record: Record, key: str = "where") -> int | None:
    """Place (from 1) of the first carrying variable among those beyond the twist.

    ``remaining`` is the map after the accepted effects; where none was accepted, the first one.
    """
    carriers = record["carriers"]
    if not carriers or "found" not in record:
        return None
    found = record["found"]
    rows = sorted(found.get(key) or found.get("where") or [], key=lambda row: -row["share"])
    order = [row["variable"] for row in rows if row["variable"] != TWIST]
    places = [order.index(name) + 1 for name in carriers if name in order]
    # A carrier without a place counts as last.
    return min(places, default=len(order) + 1)


def error_fall(record: Record) -> float | None:
    """1 - (E_fixed^2 - E_true^2)/(E_base^2 - E_true^2) of held-out velocity errors.

    None where nothing is planted, the truth is not in the catalogue, or the base model's free run
    is hardly worse than the truth's.
    """
    true, steps = record.get("true_velocity_error"), record.get("found", {}).get("steps")
    if true is None or not steps or not planted(record):
        return None
    base, fixed = steps[0]["velocity_error"], steps[-1]["velocity_error"]
    if base is None or fixed is None or base**2 < CLEAR * true**2:
        return None
    return 1.0 - (fixed**2 - true**2) / (base**2 - true**2)


def _proposal(record: Record) -> dict[str, Any] | None:
    return record.get("found", {}).get("proposal")


def law_proposed(record: Record) -> bool | None:
    """Whether a law is proposed for what is outside the catalogue; None: nothing is."""
    return bool(_proposal(record)) if set(planted(record)) & UNNAMED else None


def law_needless(record: Record) -> bool | None:
    """Whether a law is proposed though nothing is missing, or a name has it; None elsewhere."""
    return None if set(planted(record)) & UNNAMED else bool(_proposal(record))


def law_right(record: Record) -> bool | None:
    """Whether the proposal's site and main variable are right; None where none is wanted."""
    outside = [name for name in planted(record) if name in UNNAMED]
    if not outside:
        return None
    said = _proposal(record)
    item = EVERYTHING[outside[0]]
    return bool(
        said and said["site"] == item.site and set(said["variables"]) & set(item.main_variables)
    )


def law_form(record: Record) -> bool | None:
    """Whether the form is right, or in the set of laws that the data cannot tell apart; None where
    no law of the grammar states what is planted, or none is wanted."""
    wanted = {form for name in planted(record) for form in FORMS.get(name, ())}
    if not wanted:
        return None
    said = _proposal(record)
    if not said:
        return False
    names = [said["name"], *(row["name"] for row in said.get("alternatives", ()))]
    return bool(wanted & set(names[:LARGEST_SET]))


LAW_FALL = 0.8
"""Share of the way from the base model's squared velocity error to what the true law reaches, on
a run that the diagnosis has not seen, that a proposed law must go."""


def law_way(record: Record) -> float | None:
    """How much of that way the proposed law goes; None where none is wanted, or where the base
    model's free run is hardly worse than the truth's. 0 without a proposal."""
    if law_proposed(record) is None:
        return None
    errors = record.get("unseen")
    if not errors:
        return 0.0
    base, law, truth = (errors[key] ** 2 for key in ("base", "law", "truth"))
    return None if base < CLEAR * truth else (base - law) / (base - truth)


def law_helps(record: Record) -> bool | None:
    """Whether the proposed law goes most of that way; None: see `law_way`."""
    way = law_way(record)
    return None if way is None else way >= LAW_FALL


def tie_resolved(record: Record) -> bool | None:
    """Whether, with the proposed experiment, the true effects were named without ties.

    None where there was no tie that holds the truth, or no experiment was made.
    """
    truth = set(planted(record))
    if "after" not in record or not any(
        len(names) > 1 and truth & set(names) for names in named_sets(record)
    ):
        return None
    after = named_sets({"found": record["after"]})
    return all([name] in after for name in truth)


def sensing(record: Record) -> str | None:
    """How the case is measured; None: with white noise."""
    return (record["case"].get("sensing") or {}).get("name")


def right(record: Record) -> bool:
    """Whether the verdict is one that a user is well served with.

    Nothing planted: "adequate". Effects of the catalogue: each named, alone or in a set of at most
    three. Outside of it: "unknown", after one partial fit at most. Of speeds from counts also an
    "unknown" that names nothing wrong.
    """
    names = planted(record)
    if sensing(record) == ENCODER and verdict(record) == "unknown" and not wrongly_named(record):
        return True
    if not names:
        return verdict(record) == "adequate"
    if set(names) & UNNAMED:
        return said_unknown(record)
    if log_named(record) is not None:
        return bool(log_named(record))
    if len(names) == 1:
        return in_set(record, names[0])
    return all(found_anywhere(record, name) for name in names)


def wrongly_named(record: Record) -> bool:
    """Whether a name was given that no planted effect is behind.

    One partial fit to what is outside the catalogue is none.
    """
    outside = set(planted(record)) & UNNAMED
    return accepted_unplanted(record) and not (outside and said_unknown(record))


def of_baseline(record: Record) -> Record | None:
    """The record with the baseline's names in place of the diagnosis's; None: it was not asked."""
    return {**record, "found": record["baseline"]} if "baseline" in record else None


def _baseline(check: Callable[[Record], bool]) -> Callable[[Record], bool | None]:
    def answer_of(record: Record) -> bool | None:
        other = of_baseline(record)
        return None if other is None else check(other)

    return answer_of


def named_exactly(record: Record) -> bool:
    """Whether what is planted is named, without alternatives and without anything else."""
    return alone(record) if planted(record) else verdict(record) == "adequate"


def refused(record: Record) -> bool:
    """Whether the input was refused."""
    return record.get("error_class") == "InputError"


def crashed(record: Record) -> bool:
    """Whether it failed otherwise."""
    return "error" in record and not refused(record)


def warned(record: Record) -> bool | None:
    """Whether a library warned of anything; None: it was not looked for."""
    return bool(record["library_warnings"]) if "library_warnings" in record else None


def identify_failed(record: Record) -> bool | None:
    """Whether `identify` refused the logs or crashed; None: it was not asked."""
    return "error" in record["identify"] if "identify" in record else None


def _off(stated: dict[str, Any], truth: float) -> float:
    """Distance of a stated number from the truth, in its standard deviations."""
    away = abs(stated["value"] - truth)
    return away / stated["std"] if stated["std"] else (float("inf") if away else 0.0)


def sizes_off(record: Record) -> list[float]:
    """Deviations [std] of each planted number whose effect was accepted."""
    stated = record.get("sizes", {})
    return [
        _off(stated[f"{item['name']}.{key}"], value)
        for item in record["case"]["planted"]
        for key, value in item["values"].items()
        if f"{item['name']}.{key}" in stated
    ]


def sizes_inside(record: Record) -> list[bool]:
    """For each planted number whose effect was accepted: does its 95 % interval hold it?"""
    return [off <= INTERVAL for off in sizes_off(record)]


def base_off(record: Record) -> dict[str, float | None]:
    """Deviations [std] of the base parameters; None where no interval is stated."""
    return _base_off(record["case"], record.get("base", {}))


def identified_base_off(record: Record) -> dict[str, float | None]:
    """The same of what `identify` states of the base model alone."""
    return _base_off(record["case"], record.get("identify", {}).get("base", {}))


def _base_off(case: dict[str, Any], stated: dict[str, Any]) -> dict[str, float | None]:
    return {
        name: None if stated[name]["std"] is None else _off(stated[name], truth)
        for name, truth in case.get("platform", {}).items()
        if name in stated
    }


# --- many records ----------------------------------------------------------------------------


def by_kind(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Records by kind of case."""
    groups: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        groups[record["case"]["kind"]].append(record)
    return dict(groups)


def confusion(records: Iterable[Record]) -> dict[str, dict[str, int]]:
    """Planted x answered, for cases with one effect or none."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for record in records:
        names = planted(record)
        if len(names) < 2:
            table[names[0] if names else "none"][answer(record)] += 1
    order = ["none", *CATALOGUE, *KINEMATICS, *LAWS]
    return {name: dict(table[name].most_common()) for name in order if name in table}


def smallest_detectable(records: Iterable[Record]) -> dict[str, float | None]:
    """Smallest factor on an effect's size from which on it is found in `DETECTED` of the cases."""
    cases: dict[str, dict[float, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for record in records:
        for item in record["case"]["planted"]:
            if item["name"] in CATALOGUE:
                cases[item["name"]][item["factor"]].append(in_set(record, item["name"]))
    found: dict[str, float | None] = {}
    for name in (name for name in CATALOGUE if name in cases):
        found[name] = None
        # From large to small: every larger factor must be detected as well.
        for factor in sorted(cases[name], reverse=True):
            if fmean(cases[name][factor]) < DETECTED:
                break
            found[name] = factor
    return found


def _single(check: Callable[[Record, str], bool]) -> Callable[[Record], bool]:
    return lambda record: check(record, planted(record)[0])


def _shares(records: Sequence[Record], **checks: Callable[[Record], bool | None]) -> dict[str, Any]:
    return {name: Proportion.of(map(check, records)).to_dict() for name, check in checks.items()}


def _numbers(records: Sequence[Record]) -> dict[str, Any]:
    falls = [fall for record in records if (fall := error_fall(record)) is not None]
    sets = [len(names) for record in records for names in named_sets(record)]
    return {
        "error_fall_median": median(falls) if falls else None,
        "error_fall_of_95": Proportion.of(fall >= 0.95 for fall in falls).to_dict(),
        "tie_resolved": Proportion.of(map(tie_resolved, records)).to_dict(),
        "mean_set_size": fmean(sets) if sets else None,
    }


def _within(offs: Iterable[float | None], bound: float) -> dict[str, Any]:
    return Proportion.of(None if off is None else off <= bound for off in offs).to_dict()


def _intervals(records: Sequence[Record]) -> dict[str, Any]:
    """How often stated numbers hold the truth, of the diagnosis and of `identify`."""
    sizes = [off for record in records for off in sizes_off(record)]
    found = {"sizes_inside": _within(sizes, INTERVAL), "sizes_within_3": _within(sizes, BOUND)}
    for name, of in (("base", base_off), ("identified_base", identified_base_off)):
        cases = [list(of(record).values()) for record in records]
        offs = [off for case in cases for off in case]
        worst = [max((o for o in case if o is not None), default=None) for case in cases]
        found |= {
            f"{name}_stated": Proportion.of(off is not None for off in offs).to_dict(),
            f"{name}_inside": _within(offs, INTERVAL),
            f"{name}_within_3": _within(offs, BOUND),
            f"{name}_all_within_3": _within(worst, BOUND),
        }
    return found


SHARES = ("explained_share", "predictable_share")
"""Keys of a diagnosis's JSON whose median is given."""


def _medians(records: Sequence[Record]) -> dict[str, float | None]:
    found = {}
    for key in SHARES:
        known = [share for r in records if (share := r.get("found", {}).get(key)) is not None]
        found[f"{key}_median"] = median(known) if known else None
    return found


def _grouped(
    records: Sequence[Record], of: Callable[[Record], str | None]
) -> dict[str, dict[str, Any]]:
    """The share that is right by a feature of the case; none where all cases have one value."""
    groups: dict[str, list[bool]] = defaultdict(list)
    for record in records:
        groups[of(record) or ""].append(right(record))
    if len(groups) < 2:
        return {}
    return {name: Proportion.of(groups[name]).to_dict() for name in sorted(groups)}


def _detail(record: Record) -> str:
    """How a case is measured, with the counts of an encoder and what is planted under them."""
    name = sensing(record) or "white"
    if name != ENCODER:
        return name
    counts = record["case"]["sensing"]["values"]["counts"]
    return f"{'+'.join(planted(record)) or 'nothing'}, {counts:.0f} counts"


def _score_kind(kind: str, records: Sequence[Record]) -> dict[str, Any]:
    return _of_every_kind(records) | _of_one_kind(kind, records)


def _of_every_kind(records: Sequence[Record]) -> dict[str, Any]:
    seconds = sorted(record["seconds"] for record in records)
    shares = _shares(
        records,
        right=right,
        wrongly_named=wrongly_named,
        refused=refused,
        crashed=crashed,
        identify_failed=identify_failed,
        warned=warned,
        named_exactly=named_exactly,
        law_needless=law_needless,
        baseline_right=_baseline(right),
        baseline_wrongly_named=_baseline(wrongly_named),
        baseline_named_exactly=_baseline(named_exactly),
    )
    return {
        "cases": len(records),
        "errors": sum("error" in record for record in records),
        **shares,
        "right_by_sensing": _grouped(records, _detail),
        "verdicts": dict(Counter(map(verdict, records)).most_common()),
        **_intervals(records),
        **_medians(records),
        "seconds_median": median(seconds),
        "seconds_longest": seconds[-1],
    }


def _of_one_kind(kind: str, records: Sequence[Record]) -> dict[str, Any]:
    """What only some kinds are scored for."""
    if kind == "counts" or kind in sensors.ALL or kind == "noise":
        return {}
    if kind == "none":
        alarm = _shares(records, false_alarm=lambda record: verdict(record) != "adequate")
        rates = sorted({record["case"]["rate"] for record in records})
        by_rate = {
            f"{rate:g}": Proportion.of(
                verdict(r) != "adequate" for r in records if r["case"]["rate"] == rate
            ).to_dict()
            for rate in rates
        }
        return alarm | {"false_alarm_by_rate": by_rate}
    if kind == "two":
        both = lambda r: all(found_anywhere(r, name) for name in planted(r))  # noqa: E731
        return _shares(
            records,
            both_found=both,
            exactly_both=alone,
            coulomb_called_stribeck=_called_stribeck,
            accepted_unplanted=accepted_unplanted,
        ) | _numbers(records)
    if kind in ("unknown", "regime", "law", "foreign") or kind in UNNAMED:
        ranks = {
            f"carrier_first_or_second_{key}": Proportion.of(
                None if (rank := carrier_rank(record, key)) is None else rank <= 2
                for record in records
            ).to_dict()
            for key in ("where", "remaining")
        }
        laws = {"law_proposed": law_proposed, "law_right": law_right}
        laws |= {"law_form": law_form, "law_helps": law_helps}
        said = {"said_unknown": said_unknown, "regime_right": regime_right}
        return _shares(records, **said, **laws) | ranks
    if kind == "differ":
        return _shares(
            records, log_named=log_named, log_told=log_told, accepted_unplanted=accepted_unplanted
        )
    return _shares(
        records,
        in_set=_single(in_set),
        alone=alone,
        confidently_wrong=confidently_wrong,
        accepted_unplanted=accepted_unplanted,
    ) | _numbers(records)


def _called_stribeck(record: Record) -> bool:
    names = {named[0] for named in named_sets(record)}
    return "wheel_coulomb_friction" in planted(record) and "wheel_stribeck_friction" in names - set(
        planted(record)
    )


def score(records: Iterable[Record]) -> dict[str, Any]:
    """All scores, JSON-able: by kind of case, confusion matrix, smallest detectable factors."""
    records = list(records)
    groups = by_kind(records)
    kinds = {kind: _score_kind(kind, rows) for kind, rows in groups.items() if kind != "sweep"}
    single = [record for record in records if record["case"]["kind"] != "two"]
    usual = [record for record in single if record["case"]["kind"] != "sweep"]
    return {
        "kinds": kinds,
        "confusion": {kind: confusion(rows) for kind, rows in by_kind(usual).items()},
        "smallest_detectable_factor": smallest_detectable(groups.get("sweep", [])),
    }
