"""Prints docs/settings.md: ``python -m tests.structure.settings_page > docs/settings.md``.

Every setting of the settings dataclasses with its default, unit and the reason for it, as the
fields' metadata hold them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass
from typing import Any

from identification.comparison import ComparisonSettings
from identification.diagnosis.settings import DiagnosisSettings
from identification.fitting.settings import FitSettings
from identification.logs.settings import LogSettings
from identification.mechanisms.settings import MechanismSettings
from identification.residual_map.settings import ResidualMapSettings
from identification.signals.filters import FilterSettings
from identification.signals.noise import NoiseSettings

SETTINGS = (
    FilterSettings,
    NoiseSettings,
    LogSettings,
    MechanismSettings,
    FitSettings,
    ResidualMapSettings,
    DiagnosisSettings,
    ComparisonSettings,
)
"""Classes on the page, each after those that it is made of."""

HEAD = """# Settings

All numbers that somebody chose for an identification, a diagnosis, a residual map or a comparison.
They are fields of frozen dataclasses, passed to the functions of the package, and `--json` prints
those in force under `settings`:

    from dataclasses import replace
    from identification import DiagnosisSettings, diagnose

    strict = DiagnosisSettings(max_p_value=0.001)
    result = diagnose(model, logs, settings=strict)
    stricter = replace(strict, fit=replace(strict.fit, min_lone_share=0.8))

This page is written by `python -m tests.structure.settings_page > docs/settings.md`, and a test
compares it with the code.
"""


def page() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(line for made in SETTINGS for line in _section(made))])


def _section(made: type) -> Iterator[str]:
    assert made.__doc__ is not None
    yield f"## {made.__name__}\n"
    yield made.__doc__.splitlines()[0] + f" In `{made.__module__}`.\n"
    yield "| name | default | unit | reason |"
    yield "| --- | --- | --- | --- |"
    default = made()
    for item in fields(made):
        yield _row(item, getattr(default, item.name))
    yield ""


def _row(item: Field[Any], value: Any) -> str:
    if is_dataclass(value):
        return f"| `{item.name}` | `{type(value).__name__}()` | | its own table |"
    unit, reason = item.metadata["unit"], item.metadata["reason"]
    return f"| `{item.name}` | {_written(value)} | {unit} | {reason} |"


def _written(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_written, value))
    return f"{value:g}" if isinstance(value, float) else f"{value}"


if __name__ == "__main__":
    print(page(), end="")
