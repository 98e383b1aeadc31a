"""What the results of a fleet's robots say together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import false_discovery_control, norm

from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.fleets.records import DIAGNOSIS, SCREEN, Record
from youbot_scripts.fleets.settings import FleetSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """An effect that a robot's diagnosis names.

    p_value : family-wise, within the robot
    beyond_chance : whether it is beyond what chance finds in a fleet of this size
    """

    robot: str
    effect: str
    p_value: float | None
    beyond_chance: bool


@dataclass(frozen=True)
class Outlier:
    """A parameter of one robot that is far from those of the fleet.

    deviations : from the median, in robust standard deviations of the fleet and of the estimate
    """

    robot: str
    parameter: str
    value: float
    median: float
    unit: str
    deviations: float


@dataclass(frozen=True)
class FleetSummary:
    """What a fleet's results say together.

    Attributes
    ----------
    verdicts : robots by verdict; without those that could not be diagnosed
    findings : effects named, by robot
    outliers : the farthest first
    unread : robots that could not be diagnosed, with the reason
    set_aside : logs that could not be used of robots that have others: robot, log, reason
    misses : of robots that the screen passes and that were diagnosed all the same, those of which
        the diagnosis says more than "adequate"
    by : robots by what their verdict comes from
    """

    verdicts: Mapping[str, int]
    findings: tuple[Finding, ...]
    outliers: tuple[Outlier, ...]
    unread: tuple[tuple[str, str], ...]
    set_aside: tuple[tuple[str, str, str], ...]
    misses: Proportion
    by: Mapping[str, int]
    settings: FleetSettings

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Each effect named: in how many robots, and in how many beyond chance."""
        named = Counter(item.effect for item in self.findings)
        sure = Counter(item.effect for item in self.findings if item.beyond_chance)
        order = sorted(named, key=lambda name: (-sure[name], -named[name], name))
        return [{"effect": name, "named": named[name], "robots": sure[name]} for name in order]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "robots": sum(self.verdicts.values()) + len(self.unread),
            "verdicts": dict(self.verdicts),
            "effects": self.effects,
            "findings": [vars(item) for item in self.findings],
            "outliers": [vars(item) for item in self.outliers],
            "unread": [{"robot": name, "reason": reason} for name, reason in self.unread],
            "set_aside": [
                {"robot": robot, "log": log, "reason": reason}
                for robot, log, reason in self.set_aside
            ],
            "screen": {"by": dict(self.by), "misses": self.misses.to_dict()},
            "settings": self.settings.to_dict(),
        }


def summary_of(
    records: Sequence[Record], settings: FleetSettings = FleetSettings()
) -> FleetSummary:
    """What results say together."""
    read = [record for record in records if "error" not in record]
    audited = [r for r in read if r["screen"]["passed"] and r["by"] == DIAGNOSIS]
    return FleetSummary(
        verdicts=Counter(record["verdict"] for record in read),
        findings=tuple(findings_of(read, settings.false_discovery_rate)),
        outliers=tuple(outliers_of(read, settings)),
        unread=tuple((r["robot"], r["error"]) for r in records if "error" in r),
        set_aside=tuple(
            (record["robot"], item["log"], item["reason"])
            for record in read
            for item in record["set_aside"]
        ),
        misses=Proportion.of(record["verdict"] != "adequate" for record in audited),
        by=Counter(record["by"] for record in read),
        settings=settings,
    )


def findings_of(read: Sequence[Record], rate: float) -> list[Finding]:
    """Effects named in robots, and which of them stand at a false discovery rate over the fleet.

    Robots are chosen by Benjamini and Hochberg's procedure (Journal of the Royal Statistical
    Society B 57(1), 1995) on the p-value of the first effect that is named, family-wise over all
    candidates; 1 where none is. In a chosen robot each effect then stands at the level at which the
    robot was chosen (Benjamini and Bogomolov, the same journal B 76(1), 2014).
    """
    if not read:
        return []
    firsts = np.array([_first_p_value(record) for record in read])
    chosen = false_discovery_control(firsts) <= rate
    level = rate * float(chosen.sum()) / len(read)
    return [
        Finding(record["robot"], effect, p_value, bool(p_value is not None and p_value <= level))
        for record in read
        for effect, p_value in record["p_values"].items()
    ]


def _first_p_value(record: Record) -> float:
    first = next(iter(record["p_values"].values()), None)
    return 1.0 if first is None else first


def outliers_of(read: Sequence[Record], settings: FleetSettings) -> list[Outlier]:
    """Parameters of robots that are far from the fleet's median, the farthest first.

    Parameters that all models hold: those of an effect that few robots have tell nothing of a
    fleet.
    """
    found: list[Outlier] = []
    for name in common_parameters(read):
        entries = [record["parameters"][name] for record in read]
        values = np.array([entry["value"] for entry in entries], float)
        stds = np.array([entry["std"] or 0.0 for entry in entries], float)
        if len(values) < settings.min_robots_of_spread:
            continue
        far = robust_deviations(values, stds)
        found += [
            Outlier(
                read[k]["robot"], name, float(values[k]), float(np.median(values)),
                entries[k]["unit"], float(far[k]),
            )
            for k in np.flatnonzero(np.abs(far) > settings.max_robust_deviations).tolist()
        ]  # fmt: skip
    return sorted(found, key=lambda item: (-abs(item.deviations), item.robot, item.parameter))


def robust_deviations(values: Array, stds: Array) -> Array:
    """(n,) distances from the median, in robust standard deviations.

    Parameters
    ----------
    values, stds : (n,) of one parameter; a value that is known badly is far only beyond its own
        standard deviation too
    """
    away = values - np.median(values)
    # In normal standard deviations.
    spread = float(np.median(np.abs(away))) / float(norm.ppf(0.75))
    scale = np.hypot(spread, stds)
    # Where all are the same there is no spread, and none is far.
    return np.divide(away, scale, out=np.zeros_like(away), where=scale > 0)


def common_parameters(read: Sequence[Record]) -> list[str]:
    """Names of the parameters that the models of all robots hold."""
    if not read:
        return []
    return [name for name in read[0]["parameters"] if all(name in r["parameters"] for r in read)]


@dataclass(frozen=True)
class Cost:
    """What robots cost: seconds of one core, in the mean.

    screened, diagnosed : of those whose verdict comes from each; None of none
    robots, total : all, and their seconds together
    """

    screened: float | None
    diagnosed: float | None
    robots: int
    total: float

    @classmethod
    def of(cls, records: Sequence[Record], costs: Sequence[Mapping[str, float]]) -> Cost:
        """From the cost of each robot."""
        seconds = {
            by: [
                cost["cpu"]
                for record, cost in zip(records, costs, strict=True)
                if record.get("by") == by
            ]
            for by in (SCREEN, DIAGNOSIS)
        }
        means = [float(np.mean(of)) if of else None for of in seconds.values()]
        return cls(means[0], means[1], len(records), sum(cost["cpu"] for cost in costs))

    @property
    def of_many(self) -> float:
        """Hours of one core for 10,000 robots like these."""
        return MANY * self.total / max(self.robots, 1) / 3600.0

    def to_dict(self) -> dict[str, Any]:
        """JSON form, in seconds of one core; hours of many."""
        return {
            "screened": self.screened,
            "diagnosed": self.diagnosed,
            "total": self.total,
            "hours_of_10000": self.of_many,
        }


MANY = 10_000
"""Robots whose cost is told."""
