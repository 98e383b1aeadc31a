"""What an evaluation prints: one overview, then tracking and cost by controller and band."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from youbot_scripts.evaluation.metrics import AXES, STRETCH
from youbot_scripts.evaluation.summary import (
    RUNS_ALSO,
    STRETCHES,
    Result,
    by_condition,
    by_plant,
    in_words,
    models_of,
    ratios,
    unscored,
)
from youbot_scripts.shared.tables import Column, Table, columns, number, text


def tables(results: Sequence[Result], against: str) -> list[Table]:
    """All tables of an evaluation, condition by condition.

    Parameters
    ----------
    against : the controller with which the others are compared
    """
    found = [by_model(same) for same in by_plant(results) if len(models_of(same)) > 1]
    for group in by_condition(results):
        found.append(overview(group, against))
        found += [tracking(group), size(group), effort(group)]
        if RUNS_ALSO in group[0].place["plant"]:
            found.append(course(group))
    return found


def brief(results: Sequence[Result], against: str) -> list[Table]:
    """One table a plant: by model where it was driven on several, else the overview."""
    return [
        by_model(same) if len(models_of(same)) > 1 else overview(same, against)
        for same in by_plant(results)
    ]


def by_model(results: Sequence[Result]) -> Table:
    """Error of each controller with each of several models of one plant."""
    models = models_of(results)
    cells = {(r.controller, r.band, r.place["model"]): r for r in results}
    first = [result for result in results if result.place["model"] == models[0]]
    rows = [
        tuple(_mean(cells[r.controller, r.band, model], "nrmse") for model in models) for r in first
    ]
    return Table(
        "Mean normalised RMSE [%] by model",
        columns(*LEAD, *_heads(models)),
        _led(first, rows),
        _not_scored(results),
        f"{in_words({**first[0].place, 'model': ', '.join(models)})}; {_seeds(first)}",
    )


def _heads(models: Sequence[str]) -> Sequence[str]:
    """Files of models without their folders, where that tells them apart: the line above the table
    holds the whole paths, and a column as wide as a path leaves the controllers no room."""
    names = [Path(model).name for model in models]
    return names if len(set(names)) == len(names) else models


def _not_scored(results: Sequence[Result]) -> tuple[str, ...]:
    return tuple(
        f"{_band(band)}: not scored, {reason}" for band, reason in unscored(results).items()
    )


def overview(group: Sequence[Result], against: str) -> Table:
    """Mean normalised RMSE of each controller in each band of one condition."""
    bands = list(dict.fromkeys(result.band for result in group))
    names = list(dict.fromkeys(result.controller for result in group))
    by_key = {(result.controller, result.band): result for result in group}
    rows = [(name, *(_mean(by_key[name, band], "nrmse", "±") for band in bands)) for name in names]
    found = ratios(group, against)
    notes = list(_not_scored(group))
    for band in found:
        shares = [
            f"{name} {_ratio(share)}" for name, share in found[band].items() if name != against
        ]
        if shares:
            of = f"error of the worst axis over {against}'s (less is better)"
            notes.append(f"{_band(band)}, {of}: {', '.join(shares)}")
    return Table(
        "Mean normalised RMSE [%]",
        columns("controller", *(_band(band) for band in bands)),
        tuple(rows),
        tuple(notes),
        f"{in_words(group[0].place)}; {_seeds(group)}",
    )


def tracking(group: Sequence[Result]) -> Table:
    """Normalised errors by axis."""
    rows = [tuple(_mean(result, f"nrmse {axis}") for axis in AXES) for result in group]
    headers = tuple(f"{axis} %" for axis in AXES)
    return Table("Normalised RMSE by axis", columns(*LEAD, *headers), _led(group, rows))


def size(group: Sequence[Result]) -> Table:
    """Errors in SI units, and the drift that they leave."""
    rows = [
        (
            *(_short(result.mean(f"rmse {axis}")) for axis in AXES),
            _short(result.mean("position_drift")),
            _short(math.degrees(result.mean("heading_drift"))),
        )
        for result in group
    ]
    headers = ("VX m/s", "VY m/s", "W rad/s", "drift m", "drift deg")
    return Table(
        "RMSE, and drift from the integrated reference", columns(*LEAD, *headers), _led(group, rows)
    )


def effort(group: Sequence[Result]) -> Table:
    """95th percentile of the error, and size, rate and saturation of the torques."""
    rows = [
        (
            _short(100 * max(result.mean(f"worst {axis}") for axis in _moving(result))),
            _short(result.mean("effort"), 3),
            _short(result.mean("torque_rate"), 3),
            "-" if result.diverged else f"{100 * result.mean('saturation'):.1f}",
        )
        for result in group
    ]
    headers = ("worst %", "torque N m", "rate N m/s", "saturated %")
    title = "95th percentile of the worst axis' normalised error; torque and its rate (rms)"
    return Table(title, columns(*LEAD, *headers), _led(group, rows))


def course(group: Sequence[Result]) -> Table:
    """The error by stretch of time, a column for each controller."""
    rows = []
    for band in dict.fromkeys(result.band for result in group):
        same = [result for result in group if result.band == band]
        names = [name for name in same[0].metrics if name.startswith(f"{STRETCHES} ")]
        for k, name in enumerate(names):
            cells = (_short(100 * r.mean(name)) if name in r.metrics else "-" for r in same)
            stretch = f"{STRETCH * k:g}-{STRETCH * (k + 1):g}"
            rows.append(("" if k else _band(band), stretch, *cells))
    controllers = dict.fromkeys(result.controller for result in group)
    title = "Normalised RMSE [%] over the time [s] since the ramp"
    return Table(title, columns("rad/s", "time", *controllers), tuple(rows))


LEAD: tuple[str, Column] = ("rad/s", text("controller"))
"""First columns of the tables by band."""


def _led(group: Sequence[Result], rows: Sequence[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
    """Rows with band and controller in front, band by band; a band is named once."""
    ordered = sorted(zip(group, rows, strict=True), key=lambda pair: pair[0].band)
    found, last = [], None
    for result, row in ordered:
        band = _band(result.band) if result.band != last else ""
        found.append((band, result.controller, *row))
        last = result.band
    return tuple(found)


def _moving(result: Result) -> list[str]:
    return [axis for axis in AXES if result.metrics[f"worst {axis}"]["mean"] is not None] or ["VX"]


def _mean(result: Result, name: str, between: str = " ± ") -> str:
    """Mean and half interval in per cent; or how many runs diverged."""
    if result.diverged:
        return f"{result.diverged}/{result.runs} diverge"
    if not math.isfinite(result.mean(name)):
        return "-"
    mean, half = 100 * result.mean(name), 100 * result.half(name)
    digits = 0 if mean >= 100 else 1 if mean >= 10 else 2 if mean >= 1 else 3
    return f"{mean:.{digits}f}" + (f"{between}{half:.{digits}f}" if half else "")


def _short(value: float, digits: int = 2) -> str:
    """A number with few significant digits; from 100 on without an exponent."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else number(value, digits)


def _ratio(share: float) -> str:
    return f"{share:.2g}x" if math.isfinite(share) else "diverges"


def _band(band: tuple[float, float]) -> str:
    return f"{band[0]:g}-{band[1]:g}"


def _seeds(group: Sequence[Result]) -> str:
    runs = max(result.runs for result in group)
    if runs == 1:
        return "1 seed, no interval"
    return f"{runs} seeds, ± 95 % interval of Student's t"
