"""The examination of a log: its faults, what was repaired, and what it can show."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from identification.fitting.errors import NoiseLevel
from identification.fitting.kinematic_evidence import (
    CURE_OF_SWINGS,
    slipping_wheels,
    words_of_swings,
)
from identification.fitting.late_efforts import late_efforts
from identification.fitting.observability import Observability, in_motion, log_observability
from identification.fitting.regression import regression
from identification.logs.findings import Finding, LogError
from identification.logs.log import Log
from identification.logs.reading import read_log
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.registry import AnyModel, Entry, mechanism_of
from identification.signals.noise import white_noise
from youbot_env.errors import InputError
from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True)
class MotionShown:
    """What one motion of a log shows of the base model.

    Attributes
    ----------
    kind : of motion, as the mechanism names it
    start, end : [s]
    rank : number of directions of the parameters that are seen
    blind : sums of parameters that are not seen, such as "x1 + x2"
    """

    kind: str
    start: float
    end: float
    rank: int
    blind: list[str]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "kind": self.kind,
            "from": self.start,
            "to": self.end,
            "rank": self.rank,
            "blind": self.blind,
        }


@dataclass(frozen=True)
class LogObservability:
    """What a log shows of the base model, all in all and motion by motion.

    Attributes
    ----------
    scaling : of the parameters x1, x2, ..., in words
    cures : for each direction that is not seen, what would show it, in words
    motions_that_show : the same as names of calibration motions; None of an axis
    """

    total: Observability
    scaling: str
    cures: list[str]
    motions: list[MotionShown]
    motions_that_show: list[str] | None

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        found = {
            "names": list(self.total.names),
            "scaling": self.scaling,
            "rank": self.total.rank,
            "blind": self.total.describe_blind(),
            "cures": self.cures,
            "parts": [motion.to_dict() for motion in self.motions],
        }
        if self.motions_that_show is not None:
            found["motion_that_shows"] = self.motions_that_show
        return found


@dataclass(frozen=True)
class LogExamination:
    """Result of :func:`examine_log`.

    Attributes
    ----------
    findings : faults, repairs and hints, each with its row, column and cure where it has them
    refusal : why it cannot be used, where that is no fault of the file's content
    log : as it is used, after repairs; None where it cannot be used
    units : of a joint's channels "speed" and "torque"
    shows : what the log shows of the base model; None where it cannot be used
    """

    findings: Sequence[Finding] = ()
    refusal: str = ""
    log: Log | None = None
    units: dict[str, str] | None = None
    shows: LogObservability | None = None

    @property
    def usable(self) -> bool:
        """Whether other functions of this package take the log."""
        return self.log is not None

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation of the white noise on a joint's channels, mean over the joints."""
        assert self.log is not None, "a log that cannot be used has no noise"
        return {
            "speed": float(white_noise(self.log.velocity).mean()),
            "torque": float(white_noise(self.log.effort).mean()),
        }

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        findings = [asdict(finding) for finding in self.findings]
        if self.refusal:
            findings.append({"level": "error", "message": self.refusal})
        if self.log is None or self.shows is None:
            return {"usable": False, "findings": findings}
        return {
            "usable": True,
            "rows": len(self.log),
            "rate": self.log.rate,
            "duration": self.log.duration,
            "findings": findings,
            "noise": self.noise,
            "units": self.units,
            "shows": self.shows.to_dict(),
        }


def examine_log(
    path: str | os.PathLike[str],
    kind: Entry,
    *,
    geometry: Geometry | None = None,
    unit: str = "rad",
) -> LogExamination:
    """Read a log and say what is wrong with it, or what it can show.

    Parameters
    ----------
    kind : of the mechanism that the log is of, see ``mechanisms.registry.kind``
    geometry : of the platform; the youBot's by default
    unit : of an axis' position, "rad" or "m"
    """
    try:
        log = read_log(path, kind.joints, geometry=geometry)
        start = (kind.whole or kind.start)([log], unit)
    except LogError as error:
        return LogExamination(most_serious_first(error.findings))
    except InputError as error:
        return LogExamination(refusal=str(error))
    mechanism = mechanism_of(start, geometry)
    shows = log_shows(log, mechanism, start.theta)
    found = most_serious_first([*log.findings, *faults_of_joints(log, mechanism, start.theta)])
    return LogExamination(found, "", log, joint_units(start), shows)


def faults_of_joints(log: Log, mechanism: Mechanism, theta: np.ndarray) -> list[Finding]:
    """Faults of single joints' columns that only a model of the motion shows.

    ``theta`` (P,): where the columns of the model's parameters are computed.
    """
    samples, found = mechanism.samples(log), list[Finding]()
    late = late_efforts(mechanism, theta, [samples])
    if late is not None:
        found.append(Finding("warning", late.brief, cure=late.cure))
    swings = slipping_wheels(mechanism, theta, [samples], [NoiseLevel.of(samples).speed]).swings
    if swings:
        found.append(Finding("warning", words_of_swings(swings), cure=CURE_OF_SWINGS))
    return found


def most_serious_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Errors, warnings, repairs, remarks: each kind in the order in which it was found."""
    levels = ("error", "warning", "repaired", "info")
    return tuple(sorted(findings, key=lambda finding: levels.index(finding.level)))


def joint_units(model: AnyModel) -> dict[str, str]:
    """Units of a joint's channels "speed" and "torque"."""
    turns = getattr(model.geometry, "turns", True)  # wheels turn; an axis turns or slides
    return {"speed": "rad/s", "torque": "N m"} if turns else {"speed": "m/s", "torque": "N"}


def log_shows(log: Log, mechanism: Mechanism, theta: np.ndarray) -> LogObservability:
    """What a log and each of its motions show of a mechanism's parameters around theta (P,).

    What stands still shows nothing: its noise or counts are no evidence of a friction.
    """
    samples = mechanism.samples(log)
    rows = regression(mechanism, theta, samples, np.flatnonzero(mechanism.free))
    rows = in_motion(samples, rows)
    total = log_observability(mechanism, [rows])
    motions = []
    for part in mechanism.parts(samples):
        seen = log_observability(mechanism, [rows.between(part.start, part.end)])
        blind = seen.describe_blind()
        motions.append(MotionShown(part.kind, part.start, part.end, seen.rank, blind))
    name = mechanism.conventions.motion_that_shows
    named = [name(mechanism.geometry, direction) for direction in total.blind] if name else None
    cures = [mechanism.advice(direction) for direction in total.blind]
    return LogObservability(total, mechanism.scaling, cures, motions, named)
