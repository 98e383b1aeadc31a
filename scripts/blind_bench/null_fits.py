"""Fits of platforms to which nothing is added, for a calibration page; they are resumed.

What `identify` states costs one to two seconds a replicate, and p-values, which try all candidates
and draw the residual map, three to five times as much: they have a number of replicates each.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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
from youbot_scripts.shared.commits import commit
from youbot_scripts.shared.results_folder import failure, resumed


class Fit(NamedTuple):
    """A fit: number ``index`` of a kind at a seed."""

    kind: str
    index: int
    seed: int

    @property
    def key(self) -> str:
        """Its name in a folder."""
        return f"{self.kind}-{self.seed}-{self.index}"


def null_fits(count: int, seed: int, jobs: int = 1, folder: Path | None = None) -> list[Record]:
    """What `identify` states of ``count`` platforms, resumed from a folder as the trials are.

    base : see `stated_base`; misfit : whether it says that something is missing
    """
    return _replicates(_identified, "fits", count, seed, jobs, folder)


def null_p_values(count: int, seed: int, jobs: int = 1, folder: Path | None = None) -> list[Record]:
    """p-values of the first ``count`` of these platforms, resumed as well.

    ``p_value``: the least of all candidates', family-wise; ``map_p_value``: that of the residual
    map's variables, of which ``leading`` have a share.
    """
    return _replicates(_ranked, "p_values", count, seed, jobs, folder)


State = Callable[[Log, int], Record]
"""What is stated of a log; the second number is the seed of random signs."""


def _replicates(
    state: State, name: str, count: int, seed: int, jobs: int, folder: Path | None
) -> list[Record]:
    """What is stated of ``count`` platforms; ``name``: of its folder in that of the trials."""
    fits = [Fit(NULLS[k % len(NULLS)], k // len(NULLS), seed) for k in range(count)]
    with common.progress(len(fits), name.replace("_", "-")) as advance:
        done = resumed(
            partial(_replicate, state),
            {item.key: item for item in fits},
            lambda record: record["fit"],
            jobs=jobs,
            folder=None if folder is None else folder / name,
            what="fit",
            progress=advance,
        )
    return [done[item.key] for item in fits]


def _replicate(state: State, item: Fit) -> Record:
    # Another seed than the bench's cases of the same number.
    case = draw_case(item.kind, item.index, item.seed + 1_000_000)
    dt, _ = tick(case.rate)
    twist = references(case.kind, case.index, case.seed, dt)["calibration"]
    log = log_along(case, "calibration", twist)
    record: Record = {"fit": item.key, "case": case.to_dict(), "commit": commit()}
    try:
        # Random signs of its own: replicates that share them are not independent.
        return record | state(log, case.seed + case.index)
    except InputError as error:
        return record | failure(error)


def _identified(log: Log, seed: int) -> Record:
    found = identify([log], recursive=False, seed=seed)
    return {"base": stated_base(found.model), "misfit": found.misfit is not None}


def _ranked(log: Log, seed: int) -> Record:
    model = load_model("paper")
    mechanism = mechanism_of(model)
    data = LoggedData(mechanism, [log], seed)
    base = fit_base(data, mechanism, model.theta)
    names = mechanism.catalogue.names()
    p_values = rank(data, base, names, np.random.default_rng(seed)).p_values
    shown = residual_map(mechanism, base.theta, data.samples, seed=seed)
    return {
        "p_value": min(p_values.values()),
        "map_p_value": min(share.p_value for share in shown.shares),
        "leading": list(shown.leading),
    }
