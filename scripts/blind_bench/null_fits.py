"""Cheap fits of platforms to which nothing is added, for a calibration page; they are resumed."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from identification.diagnosis.candidates import fit_base, rank
from identification.diagnosis.structures import LoggedData
from identification.fitting.identify import identify
from identification.logs.log import Log
from identification.mechanisms.registry import mechanism_of
from identification.residual_map.residual_map import residual_map
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_scripts.blind_bench.cases import draw_case, log_along, references, tick
from youbot_scripts.blind_bench.promises import NULLS
from youbot_scripts.blind_bench.trials import Record, stated_base
from youbot_scripts.shared import options as common
from youbot_scripts.shared.results_folder import failure, resumed

FITS = "fits"
"""Folder for the cheap fits, in that of the bench's trials."""


class Fit(NamedTuple):
    """A cheap fit: number ``index`` of a kind at a seed."""

    kind: str
    index: int
    seed: int


def null_fits(count: int, seed: int, jobs: int = 1, folder: Path | None = None) -> list[Record]:
    """``count`` fits to which nothing is added, resumed from a folder as the trials are."""
    fits = [Fit(NULLS[k % len(NULLS)], k // len(NULLS), seed) for k in range(count)]
    with common.progress(len(fits), "fitting") as advance:
        done = resumed(
            null_fit,
            {_key(item): item for item in fits},
            lambda record: record["fit"],
            jobs=jobs,
            folder=None if folder is None else folder / FITS,
            what="fit",
            progress=advance,
        )
    return [done[_key(item)] for item in fits]


def _key(item: Fit) -> str:
    return f"{item.kind}-{item.seed}-{item.index}"


def null_fit(item: Fit) -> Record:
    """A platform's calibration motion alone: what `identify` states, and p-values.

    ``p_value``: the least of all candidates', family-wise; ``map_p_value``: that of the residual
    map's variables, of which ``leading`` have a share.
    """
    # Another seed than the bench's cases of the same number.
    case = draw_case(item.kind, item.index, item.seed + 1_000_000)
    dt, _ = tick(case.rate)
    twist = references(case.kind, case.index, case.seed, dt)["calibration"]
    log = log_along(case, "calibration", twist)
    record: Record = {"fit": _key(item), "case": case.to_dict()}
    try:
        # Random signs of its own: replicates that share them are not independent.
        return record | _fitted(log, case.seed + case.index)
    except InputError as error:
        return record | failure(error)


def _fitted(log: Log, seed: int) -> Record:
    model = load_model("paper")
    found = identify([log], recursive=False, seed=seed)
    mechanism = mechanism_of(model)
    data = LoggedData(mechanism, [log], seed)
    base = fit_base(data, mechanism, model.theta)
    names = mechanism.catalogue.names()
    p_values = rank(data, base, names, np.random.default_rng(seed)).p_values
    shown = residual_map(mechanism, base.theta, data.samples, seed=seed)
    return {
        "base": stated_base(found.model),
        "misfit": found.misfit is not None,
        "p_value": min(p_values.values()),
        "map_p_value": min(share.p_value for share in shown.shares),
        "leading": list(shown.leading),
    }
