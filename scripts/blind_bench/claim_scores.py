"""The score of what a tool claims of a blind set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from identification.fitting.settings import FitSettings
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from identification.signals.filters import filter_samples, settled
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.blind_bench import scores
from youbot_scripts.blind_bench.claims import Claim, read_claims
from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.blind_bench.published import Published, read_table

WAY = 0.8
"""Share of the way from the base model's squared force error to the noise that counts."""

CLEAR = 1.5
"""Least squared force error of the base model over the noise's for which its fall is judged."""


def score_claims(published: Published, path: Path) -> dict[str, Any]:
    """Scores of a tool's answers to a blind set, of each kind of case and of all; cases without an
    answer count as wrong.

    Raises
    ------
    InputError
        If the answers are of other cases, or a prediction has another length.
    """
    claims, codes = read_claims(path), published.codes
    strangers = sorted(set(claims) - set(codes))
    if strangers:
        raise InputError(f"{path}: case {strangers[0]!r} is not in {published.folder}")
    rows = [_scored(published, code, claims.get(code), path.parent) for code in codes]
    kinds = sorted({str(row["kind"]) for row in rows})
    table = {kind: _shares([row for row in rows if row["kind"] == kind]) for kind in kinds}
    return {"all": _shares(rows), **table, "unanswered": sum(code not in claims for code in codes)}


CHECKS = ("right", "wrongly_named", "named_exactly", "law_right", "error_falls")
"""Of one claim, each true, false, or None where it is not asked."""


def _scored(
    published: Published, code: str, claim: Claim | None, folder: Path
) -> dict[str, bool | None | str]:
    answer = published.answer(code)
    found = {} if claim is None else claim.found()
    record = {"case": answer["case"], "carriers": answer["carriers"], "found": found}
    return {
        "kind": answer["case"]["kind"],
        "right": claim is not None and scores.right(record),
        "wrongly_named": claim is not None and scores.wrongly_named(record),
        "named_exactly": claim is not None and scores.named_exactly(record),
        "law_right": scores.law_right(record),
        "error_falls": _falls(published, code, answer, claim, folder),
    }


def _shares(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    rows = list(rows)
    found = {key: Proportion.of(row[key] for row in rows).to_dict() for key in CHECKS}
    return {"cases": len(rows), **found}


def _falls(
    published: Published, code: str, answer: Mapping[str, Any], claim: Claim | None, folder: Path
) -> bool | None:
    """Whether the unseen run's force error falls most of the way; None where nothing is missing."""
    base, floor = answer["base_error"] ** 2, answer["noise_floor"] ** 2
    if not answer["case"]["planted"] or base < CLEAR * floor:
        return None
    if claim is None or claim.predictions is None:
        return False
    path = folder / claim.predictions
    table = read_table(path)
    missing = [f"effort_{wheel}" for wheel in WHEELS if f"effort_{wheel}" not in table]
    if missing:
        raise InputError(f"{path}: column {missing[0]!r} is missing; see the set's README.md")
    effort = np.column_stack([table[f"effort_{wheel}"] for wheel in WHEELS])
    log = published.unseen(code)
    if len(effort) != len(log):
        raise InputError(f"{path}: {len(effort)} rows, where the motion has {len(log)}")
    return (base - force_error(log, effort) ** 2) / (base - floor) >= WAY


def force_error(log: Log, effort: np.ndarray) -> float:
    """Force error of predicted torques (N, 4) [N m] on a log."""
    model, settings = load_model("paper"), FitSettings().filter
    mechanism = Mecanum(model.geometry, model.structure)
    (samples,) = mechanism.samples_of([log])
    rate, dt = settings.rate, samples.dt
    first = settled(rate, dt, settings.settling_time_constants)
    measured = filter_samples(mechanism.measured_force(samples), rate, dt)[first:]
    force = (effort @ mechanism.jacobian) * mechanism.force_scale
    predicted = filter_samples(force, rate, dt)[first:]
    return float(np.sqrt(((measured - predicted) ** 2).sum() / (measured**2).sum()))
