"""Logs of the second simulator, whose equations are others than those that are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from identification.logs.log import Log
from youbot_scripts.blind_bench.cases import draw_case, log_along, references, tick

FEW = (("multisine_a", "multisine_b"), ("calibration", "multisine_a"))
"""Two logs, and one besides calibration."""


def blind_logs(
    kind: str,
    names: Sequence[str],
    values: Mapping[str, float] | None = None,
    *,
    seed: int = 5,
    index: int = 0,
    factor: float | None = None,
    only_in: Sequence[str] = (),
) -> list[Log]:
    """Some logs of a case, of what is planted with some values of one's own.

    Parameters
    ----------
    kind : of a case of the bench, or the name of an effect or a noise
    names : of the logs
    factor : on the size of what is planted; only_in : logs in which it is, () for all
    """
    case = draw_case(kind, index, seed, factor=factor)
    planted = tuple(
        replace(item, values={**item.values, **(values or {})}, logs=tuple(only_in))
        for item in case.planted
    )
    case = replace(case, planted=planted)
    dt, _ = tick(case.rate)
    twists = references(case.kind, case.index, case.seed, dt)
    return [log_along(case, name, twists[name]) for name in names]
