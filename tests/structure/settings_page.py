"""Writes docs/settings.md: ``python -m tests.structure.settings_page docs/settings.md``.

Every setting of the settings dataclasses with its default, unit and the reason for it, as the
fields' metadata hold them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import Field, fields, is_dataclass
from pathlib import Path
from typing import Any

from controllers.computed_torque.adaptive import AdaptiveSettings
from controllers.computed_torque.feedback_design import FeedbackSettings
from controllers.computed_torque.online_estimator import EstimatorSettings
from controllers.computed_torque.online_regression import RowSettings
from controllers.linear.linear_system import DriveSettings, LinearisationSettings
from controllers.linear.margins import MarginSettings
from controllers.lqi.design import LQISettings
from controllers.pid.design import PIDSettings
from controllers.policy.inputs import FeatureSettings
from controllers.policy.policy import PolicySettings
from controllers.tuning.tunable_laws import GainRanges
from controllers.tuning.tuning import SearchSettings
from identification.comparison import ComparisonSettings
from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.settings import (
    ChangingLawSettings,
    FitSettings,
    HarmonicScanSettings,
    LateEffortSettings,
    PredictabilitySettings,
    WheelEvidenceSettings,
)
from identification.importing.settings import ImportSettings
from identification.kinematics.settings import KinematicsSettings
from identification.logs.settings import LogSettings
from identification.mechanisms.settings import MechanismSettings
from identification.proposal.settings import ProposalSettings
from identification.residual_map.settings import RegimeSettings, ResidualMapSettings
from identification.signals.filters import FilterSettings
from identification.signals.held import HeldSettings
from identification.signals.noise import NoiseSettings
from youbot_env.contact.settings import EngineSettings
from youbot_env.tracking.task import REWARD_TERMS, TrackingTask
from youbot_scripts.fleets.settings import FleetSettings

AREAS = {
    "Identification": (
        FilterSettings,
        NoiseSettings,
        HeldSettings,
        KinematicsSettings,
        LogSettings,
        ImportSettings,
        MechanismSettings,
        PredictabilitySettings,
        ChangingLawSettings,
        HarmonicScanSettings,
        WheelEvidenceSettings,
        LateEffortSettings,
        FitSettings,
        ResidualMapSettings,
        RegimeSettings,
        ProposalSettings,
        DiagnosisSettings,
        ComparisonSettings,
    ),
    "Controllers": (
        MarginSettings,
        LinearisationSettings,
        DriveSettings,
        PIDSettings,
        LQISettings,
        FeedbackSettings,
        RowSettings,
        EstimatorSettings,
        AdaptiveSettings,
        SearchSettings,
        GainRanges,
        FeatureSettings,
        PolicySettings,
    ),
    "Simulation and task": (EngineSettings, TrackingTask),
    "Fleets": (FleetSettings,),
}
"""Classes on the page by area, each after those that it is made of."""

SETTINGS = tuple(made for area in AREAS.values() for made in area)

HEAD = """# Settings

All numbers that somebody chose: for an identification, a diagnosis, a residual map or a comparison,
for the design of a controller, for the contact simulation and the tracking task. They are fields of
frozen dataclasses, passed to the functions of the packages:

    from dataclasses import replace
    from identification import DiagnosisSettings, diagnose

    strict = DiagnosisSettings(max_p_value=0.001)
    result = diagnose(model, logs, settings=strict)
    stricter = replace(strict, fit=replace(strict.fit, min_lone_share=0.8))

`--json` of `identify`, `compare`, `diagnose` and `add` prints those in force under `settings`. This
page is written by `python -m tests.structure.settings_page docs/settings.md`, and a test compares
it with the code.
"""


def page() -> str:
    """The whole page."""
    lines = [HEAD]
    for area, classes in AREAS.items():
        lines.append(f"## {area}\n")
        lines += [line for made in classes for line in _section(made)]
    return "\n".join([*lines, *_reward_terms()])


def _section(made: type) -> Iterator[str]:
    assert made.__doc__ is not None
    inherited = {item.name: base for base in _bases(made) for item in fields(base)}
    yield f"### {made.__name__}\n"
    yield made.__doc__.splitlines()[0] + f" In `{made.__module__}`.\n"
    if inherited:
        names = ", ".join(f"`{base.__name__}`" for base in _bases(made))
        yield f"It has all fields of {names} and these:\n"
    yield from _table_head("default")
    default = made()
    for item in fields(made):
        # A default of its own would make an inherited field a different setting.
        if item.name not in inherited or item.default != _default(inherited[item.name], item.name):
            yield _row(item, getattr(default, item.name))
    yield ""


def _bases(made: type) -> list[type]:
    return [base for base in made.__bases__ if is_dataclass(base)]


def _default(made: type, name: str) -> Any:
    return next(item.default for item in fields(made) if item.name == name)


def _row(item: Field[Any], value: Any) -> str:
    if is_dataclass(value):
        return f"| `{item.name}` | `{type(value).__name__}()` | | its own table |"
    if isinstance(value, Mapping):
        return f"| `{item.name}` | {{}} | | by term; those left out are in the table below |"
    unit, reason = item.metadata["unit"], item.metadata["reason"]
    return f"| `{item.name}` | {_written(value)} | {unit} | {reason} |"


def _reward_terms() -> Iterator[str]:
    """Weights and margins that a task takes where none are given."""
    yield "### Terms of the reward\n"
    yield "Weights and margins of a `TrackingTask` by term. In `youbot_env.tracking.task`.\n"
    yield from _table_head("weight | margin", "unit of the margin")
    for name, term in REWARD_TERMS.items():
        numbers = f"{_written(term.weight)} | {_written(term.margin)}"
        yield f"| `{name}` | {numbers} | {term.unit} | {term.reason} |"
    yield ""


def _table_head(values: str, unit: str = "unit") -> Iterator[str]:
    head = f"| name | {values} | {unit} | reason |"
    yield head
    yield "|" + " --- |" * (head.count("|") - 1)


def _written(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_written, value))
    return f"{value:g}" if isinstance(value, float) else f"{value}"


if __name__ == "__main__":
    # The page is made before the file is opened: a setting that is refused leaves the old page.
    text = page()
    Path(sys.argv[1]).write_text(text, encoding="utf-8")
