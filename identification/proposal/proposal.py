"""A law that is proposed: its sentences, its JSON form, and its file."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.misfit import stated_estimates
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.physical_parameters import StatedParameters
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
    parameters : of the law, by name value, unit, std, and 95 % interval (None where the joint fit
        does not fit the logs)
    force_error, velocity_error : held out, of the model with it
    before : (force error, velocity error), held out, of the model without it
    share : of what the motion predicts beyond the model, held out, that it takes
    verdict : what the search says for it
    mechanism, theta : the structure with the law, and its parameters (P,) of the joint fit
    joint : parameters of the joint fit: of the law, and of all that is fitted with it. The model
        that a diagnosis writes is another one, fitted without the law
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
    joint: StatedParameters = field(repr=False)
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
    def step(self) -> tuple[str, float, float]:
        """The last one of the error as it falls: its name, and both errors with it, held out."""
        return self.name, self.force_error, self.velocity_error

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
        sizes = sizes_in_words(self.parameters)
        return [
            f"proposed law: {law.name} (site {_site(law)}){share}{self._falls}. In words: "
            f"{_small(law.meaning)}{beside}; as a formula: {law.formula} with {sizes}",
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
    def joint_fit(self) -> dict[str, Any]:
        """Parameters of base and effects as fitted with the law, in the form of a model file."""
        parameters, effects = dict[str, Any](), dict[str, Any]()
        for key, entry in stated_estimates(self.joint).items():
            effect, dot, name = key.partition(".")
            if not dot:
                parameters[key] = entry
            elif effect != self.name:  # the law's own are told apart, and first of all
                effects.setdefault(effect, {"parameters": {}})["parameters"][name] = entry
        return {"parameters": parameters, "effects": effects}

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
            "joint_fit": self.joint_fit,
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


def sizes_in_words(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Numbers with 95 % intervals, in words; of those of the wheels, such as are not zero.

    Parameters
    ----------
    parameters : by name value, unit and interval (None where there is none)
    """
    of_unit: dict[str, float] = {}
    for entry in parameters.values():
        unit = entry["unit"]
        of_unit[unit] = max(of_unit.get(unit, 0.0), abs(entry["value"]))
    small = {
        name
        for name, entry in parameters.items()
        if name.endswith(tuple(f"_{wheel}" for wheel in WHEELS))
        and abs(entry["value"]) < SETTINGS.min_shown_share * of_unit[entry["unit"]]
    }
    parts = [_sized(name, entry) for name, entry in parameters.items() if name not in small]
    rest = " (the other wheels' are near zero)" if small else ""
    return ", ".join(parts) + rest


def _sized(name: str, entry: Mapping[str, Any]) -> str:
    """A number with its unit and interval; a constant that was not fitted without one."""
    value, interval, digits = entry["value"], entry["interval"], 3
    if interval is not None and interval[1] > interval[0]:
        # As many as tell the ends apart.
        most, width = max(map(abs, interval)), interval[1] - interval[0]
        digits = max(digits, 1 + math.ceil(math.log10(most / width)))
    size = f"{name} {with_unit(f'{value:.{digits}g}', entry['unit'])}"
    if interval is None:
        return size
    low, high = (f"{end:.{digits}g}" for end in interval)
    return f"{size} ({low} to {high})"
