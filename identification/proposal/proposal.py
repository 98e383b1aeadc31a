"""A law that is proposed: its sentences, its JSON form, and its file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.mechanisms.mechanism import Mechanism
from identification.proposal.law import FoundLaw, Verdict


@dataclass(frozen=True)
class Proposal:
    """A law that may be what is missing.

    Attributes
    ----------
    law : with the values of its joint fit
    parameters : by name its value, unit, std, and 95 % interval
    force_error, velocity_error : held out, of the model with it
    share : of what the motion predicts beyond the model, held out, that it takes
    verdict : what the search says for it
    mechanism, theta : the structure with the law, and its parameters (P,) of the joint fit
    beside : accepted effects that the model holds beside it
    logs : that it was found on
    """

    law: FoundLaw
    parameters: dict[str, dict[str, Any]]
    force_error: float
    velocity_error: float
    share: float | None
    verdict: Verdict
    mechanism: Mechanism[Any] = field(repr=False)
    theta: NDArray[np.float64] = field(repr=False)
    beside: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()

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
        """What it is, in plain words."""
        law = self.law.law
        part = "" if self.share is None else f" and takes {self.share:.0%} of what was missing"
        values = ", ".join(
            f"{name} {entry['value']:.3g} {_plain_unit(entry['unit'])}".strip()
            for name, entry in self.parameters.items()
        )
        beside = f" beside {' and '.join(self.beside)}" if self.beside else ""
        return [
            f"a law that is in no catalogue explains it{part}: {_small(law.meaning)}, "
            f"{law.formula}{beside}; {values}",
            f"with it the force error is {self.force_error:.2%} and the velocity error "
            f"{self.velocity_error:.2%}, held out; chance does as much on stretches that the "
            f"search had not seen in {self.verdict.unseen_p_value:.1%} of cases",
            f"{_small(law.recognise.rstrip('.'))}; to confirm, {law.confirm}",
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        law, verdict = self.law.law, self.verdict
        return {
            "name": law.name,
            "site": SITES.get(law.place.name, law.place.name),
            "variables": list(law.variables),
            "formula": law.formula,
            "latex": law.latex,
            "meaning": law.meaning,
            "parameters": self.parameters,
            "file": None,
            "source": self.file_text,
            "force_error": self.force_error,
            "velocity_error": self.velocity_error,
            "share": self.share,
            "beside": list(self.beside),
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


def _plain_unit(unit: str) -> str:
    return "" if unit == "1" else unit
