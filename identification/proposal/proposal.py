"""A law that is proposed: its sentences, its JSON form, and its file."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import Mechanism
from identification.proposal.law import FoundLaw, Law, Verdict
from identification.proposal.settings import ProposalSettings
from youbot_env.physics.effect import with_unit
from youbot_env.physics.hardware import WHEELS


@dataclass(frozen=True)
class Proposal:
    """A law that may be what is missing.

    Attributes
    ----------
    law : with the values of its joint fit
    parameters : by name its value, unit, std, and 95 % interval
    force_error, velocity_error : held out, of the model with it
    before : (force error, velocity error), held out, of the model without it
    share : of what the motion predicts beyond the model, held out, that it takes
    verdict : what the search says for it
    mechanism, theta : the structure with the law, and its parameters (P,) of the joint fit
    beside : accepted effects that the model holds beside it
    logs : that it was found on
    starts : by log, when it began on the law's own clock [s]; {} where the law has none
    of_clock : what is known of these starts, in sentences
    noise_floor : both errors that noise leaves of the model with it; {} if not known
    """

    law: FoundLaw
    parameters: dict[str, dict[str, Any]]
    force_error: float
    velocity_error: float
    share: float | None
    verdict: Verdict
    mechanism: Mechanism[Any] = field(repr=False)
    theta: NDArray[np.float64] = field(repr=False)
    before: tuple[float, float] = (math.nan, math.nan)
    beside: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()
    starts: dict[str, float] = field(default_factory=dict[str, float])
    of_clock: tuple[str, ...] = ()
    noise_floor: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def name(self) -> str:
        """Of the effect in its file."""
        return self.law.law.name

    @property
    def file_text(self) -> str:
        """What a file for ``--effects`` holds."""
        share = "" if self.share is None else f": {self.share:.0%} of what was missing"
        # A name may hold anything; what stands in a program must not be one.
        logs = ", ".join(re.sub(r"[^\w.-]", "_", log) for log in self.logs[:SHOWN_LOGS]) + (
            " ..." if self.logs[SHOWN_LOGS:] else ""
        )
        return self.law.file_text(f"Proposed by youbot diagnose from {logs}{share}.")

    @property
    def sentences(self) -> list[str]:
        """What it is, with its site, size, share and errors; what speaks for it; what to do."""
        law = self.law.law
        share = ": " if self.share is None else f" takes {self.share:.0%} of what was missing: "
        beside = f", beside {' and '.join(self.beside)}" if self.beside else ""
        return [
            f"proposed law: {law.name} (site {_site(law)}){share}{self._falls}. In words: "
            f"{_small(law.meaning)}{beside}; as a formula: {law.formula} with {self._sizes}",
            "chance does as much on stretches that the search had not seen in "
            f"{self.verdict.unseen_p_value:.1%} of cases{self._others}",
            f"{_small(law.recognise.rstrip('.'))}; to confirm, {law.confirm}",
            *self.of_clock,
        ]

    @property
    def _falls(self) -> str:
        """How the held-out errors fall."""
        force, velocity = self.before
        parts = [f"the force error {_fall(force, self.force_error)}"]
        if math.isfinite(self.velocity_error):
            parts.append(f"the velocity error {_fall(velocity, self.velocity_error)}")
        return " and ".join(parts) + ", held out"

    @property
    def _sizes(self) -> str:
        """Its numbers with 95 % intervals; of those of the wheels, such as are not zero."""
        of_unit: dict[str, float] = {}
        for entry in self.parameters.values():
            unit = entry["unit"]
            of_unit[unit] = max(of_unit.get(unit, 0.0), abs(entry["value"]))
        small = {
            name
            for name, entry in self.parameters.items()
            if name.endswith(tuple(f"_{wheel}" for wheel in WHEELS))
            and abs(entry["value"]) < SETTINGS.min_shown_share * of_unit[entry["unit"]]
        }
        parts = [_sized(n, entry) for n, entry in self.parameters.items() if n not in small]
        rest = " (the other wheels' are near zero)" if small else ""
        return ", ".join(parts) + rest

    @property
    def _others(self) -> str:
        """Laws that the logs cannot tell from it."""
        names = [
            found.law.name for found, _ in self.verdict.alternatives[: SETTINGS.shown_alternatives]
        ]
        return f"; these logs cannot tell it from {' or '.join(names)}" if names else ""

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        law, verdict = self.law.law, self.verdict
        return {
            "name": law.name,
            "site": _site(law),
            "variables": list(law.variables),
            "formula": law.formula,
            "latex": law.latex,
            "meaning": law.meaning,
            "parameters": self.parameters,
            "file": None,
            "source": self.file_text,
            "force_error": self.force_error,
            "velocity_error": self.velocity_error,
            "before": {"force_error": self.before[0], "velocity_error": self.before[1]},
            "share": self.share,
            "beside": list(self.beside),
            "starts": self.starts,
            "recognise": law.recognise,
            "confirm": law.confirm,
            "p_value": verdict.unseen_p_value,
            "family_wise_p_value": verdict.p_value,
            "fall": {"seen": verdict.fall, "unseen": verdict.unseen_fall},
            "alternatives": [
                {
                    "name": found.law.name,
                    "meaning": found.law.meaning,
                    "formula": found.law.formula,
                    "variables": list(found.law.variables),
                    "values": dict(found.values),
                    "left": left,
                }
                for found, left in verdict.alternatives
            ],
            "tried": {"laws": verdict.tried[0], "choices": verdict.tried[1]},
            "pareto": [
                {
                    "name": found.law.name,
                    "meaning": found.law.meaning,
                    "formula": found.law.formula,
                    "length": found.law.length,
                    "left": left,
                }
                for found, left in verdict.pareto
            ],
        }


SETTINGS = ProposalSettings()

SHOWN_LOGS = 4
"""Logs that a file's first line names."""

SITES = {
    "body": "body",
    "world": "world",
    "wheel joint": "wheel",
    "roller axle": "roller",
    "log channel": "channel",
    "axis": "body",
}
"""Places where laws act, as JSON calls them."""


def _small(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def _site(law: Law) -> str:
    return SITES.get(law.place.name, law.place.name)


def _fall(before: float, after: float) -> str:
    return f"falls from {before:.2%} to {after:.2%}" if after < before else f"is {after:.2%}"


def _sized(name: str, entry: dict[str, Any]) -> str:
    """A number with its unit and interval; a constant that was not fitted without one."""
    interval = entry["interval"]
    number = f"{entry['value']:.3g}"
    size = f"{name} {with_unit(number, entry['unit'])}"
    if interval is None:
        return size
    low, high = interval
    return f"{size} ({low:.3g} to {high:.3g})"
