"""The web pages of results: what stands on them, and in which order."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.shared import result_tables
from youbot_scripts.shared.effect_tables import equations_with
from youbot_scripts.shared.report_page import (
    MAY_VANISH,
    Charts,
    Part,
    Words,
    groups_of,
    write_page,
)

if TYPE_CHECKING:
    from identification.comparison import Comparison
    from identification.diagnosis.addition import Addition
    from identification.diagnosis.report import Diagnosis
    from identification.fitting.identify import Identification
    from identification.logs.log import Log
    from identification.mechanisms.registry import AnyModel
    from youbot_scripts.shared.tables import Table

SYMBOLS = (
    "L F_X, L F_Y: generalised forces along X and Y, times L = l + h; M_W: moment about the "
    "centre; all in N m, filtered at 10 rad/s. Δ: measured less predicted."
)

Target = str | os.PathLike[str]
Found = Mapping[str, Any]


def write_identification(
    path: Target, result: Identification, logs: Sequence[Log] = (), seed: int = 0
) -> None:
    """Write the page of an identification.

    Parameters
    ----------
    logs : that it was fitted on, for their table; () leaves it out
    seed : of the residual map

    Raises
    ------
    InputError
        If the file cannot be written, or a library of the extra `plots` is missing.
    """
    title = f"Model identified: {result.model.name}"
    write_page(Path(path), title, _of_identification(result, logs, seed), seed)


def write_comparison(
    path: Target,
    result: Comparison,
    found: Found | None = None,
    seed: int | None = None,
) -> None:
    """Write the page of a comparison; ``found``: its JSON form, if it is at hand.

    Raises
    ------
    InputError
        As :func:`write_identification`.
    """
    title = f"Model compared with logs: {result.model.name}"
    parts = _of_comparison(result, found or result.to_dict())
    write_page(Path(path), title, parts, seed)


def write_diagnosis(
    path: Target,
    result: Diagnosis,
    found: Found | None = None,
    logs: Sequence[Log] = (),
    seed: int | None = None,
) -> None:
    """Write the page of a diagnosis; ``found``: its JSON form, if it is at hand.

    Raises
    ------
    InputError
        As :func:`write_identification`.
    """
    title = f"What is missing from the model: {result.model.name}"
    parts = _of_diagnosis(result, found or result.to_dict(), logs)
    write_page(Path(path), title, parts, seed)


def write_addition(
    path: Target,
    result: Addition,
    found: Found | None = None,
    logs: Sequence[Log] = (),
    seed: int | None = None,
) -> None:
    """Write the page of an effect that was added; ``found``: its JSON form, if it is at hand.

    Raises
    ------
    InputError
        As :func:`write_identification`.
    """
    title = f"{result.effect} added to {result.model.name}"
    write_page(Path(path), title, _of_addition(result, found or result.to_dict(), logs), seed)


def tables_of_identification(result: Identification) -> list[Table]:
    """Parameters, and what each motion shows of them."""
    found = result.to_dict()
    return [
        result_tables.parameters(found["combinations"] | found["parameters"]),
        result_tables.observability(found["observability"], result.mechanism.scaling),
    ]


def next_experiment(found: Found) -> list[str]:
    """The motion that best separates tied effects, if there is one."""
    proposed = found["next_experiment"]
    if not proposed:
        return []
    apart = " and ".join(proposed["separates"])
    return [f"Next experiment: motion {proposed['name']} tells {apart} apart"]


def _symbols(model: AnyModel) -> Iterator[Words]:
    """What the symbols in a platform's charts of forces mean."""
    from identification.mechanisms.quantities import FORCES
    from identification.mechanisms.registry import quantities_of

    if quantities_of(model).forces == FORCES:
        yield Words([SYMBOLS])


def _logs(logs: Iterable[Log]) -> Iterator[Table]:
    found = list(logs)
    if found:
        yield result_tables.logs(found)


def _of_identification(result: Identification, logs: Sequence[Log], seed: int) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.figures.single_charts import residual_charts
    from identification.mechanisms.registry import quantities_of
    from identification.residual_map.residual_map import residual_map

    errors = result.model.errors
    floor = errors["noise_floor"]
    yield Words([result_tables.verdict(errors["force_error"], floor["force_error"])], "verdict")
    first, others = result.warnings[: result.told_first], result.warnings[result.told_first :]
    yield Words(first, "warning")
    if result.misfit and others:
        yield Words([MAY_VANISH])
    yield Words(others, "warning")
    rows = [("the model, on its own logs", errors), ("noise floor", floor)]
    yield result_tables.errors("Errors", rows)
    yield from tables_of_identification(result)
    where = residual_map(result.mechanism, result.fit.theta, result.samples, seed=seed)
    yield result_tables.residual("What the force residual depends on", where.to_list())
    for chart in residual_charts([("", where)], quantities_of(result.model).forces):
        yield Charts([chart])
    charts = result.drawn()
    yield Charts([charts.pop("forces_0")])
    yield from _symbols(result.model)
    yield from groups_of(charts)
    yield equations_with(result.model.mechanism.name, result.mechanism.structure.effects)
    yield from _logs(logs)


def _of_comparison(result: Comparison, found: Found) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.fitting.misfit import stated_estimates

    error, floor = found["total"], found["noise_floor"]
    line = result_tables.verdict(error["force_error"], floor["force_error"])
    lines = [line, *([found["misfit"]] if found["misfit"] else []), *found["changes"]["words"]]
    yield Words(lines, "verdict")
    yield Words(list(_warnings(result)), "warning")
    rows = [("the model", error), ("noise floor", floor)]
    yield result_tables.errors("Errors, all logs that count", rows)
    charts = result.drawn()
    yield Charts([charts.pop("free_run_0")])
    if "residual" in charts:
        yield Charts([charts.pop("residual")])
    yield from _symbols(result.model)
    yield from groups_of(charts)
    yield from result_tables.errors_by_axis(found)
    yield result_tables.residual("What the force residual depends on", found["where"])
    yield result_tables.stretches(found)
    yield from result_tables.slip(found["logs"])
    model = stated_estimates(result.model)
    yield result_tables.parameters(model, "The model's parameters")
    yield result_tables.logs(item.log for item in result.logs)


def _warnings(result: Comparison) -> Iterator[str]:
    from identification.logs.log import warnings_of_logs

    if all(item.seen_in_fit for item in result.logs):
        yield "The model was fitted on these very logs: compare on others to see what it can do."
    for item in result.logs:
        if item.diverges:
            yield f"{item.log.name}: the model's free run diverges, so it has no velocity error."
        if item.slip is not None and item.slip.exceeds_noise:
            yield f"{item.log.name}: the wheels slip, or one is not what the geometry says."
    yield from warnings_of_logs([item.log for item in result.logs])


def _of_diagnosis(result: Diagnosis, found: Found, logs: Sequence[Log]) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.fitting.misfit import stated_estimates

    lines = [found["headline"], *found["words"], *found["changes"]["words"]]
    yield Words([*lines, *next_experiment(found)], "verdict")
    yield Words(found["warnings"], "warning")
    charts = result.drawn()
    yield Charts([charts.pop("errors")])
    yield result_tables.steps(found)
    for name in ("next", "residual", "forces_0"):
        if name in charts:
            yield Charts([charts.pop(name)])
    yield from _symbols(result.model)
    yield from groups_of(charts)
    yield result_tables.candidates(found)
    if found.get("proposal"):
        yield result_tables.laws(found["proposal"])
    effects = result.mechanism.structure.effects
    yield equations_with(result.model.mechanism.name, effects, found["missing"])
    model = stated_estimates(result.model)
    if result.proposal is None:
        yield result_tables.parameters(model, "Refitted parameters")
    else:
        joint = stated_estimates(result.proposal.joint)
        yield result_tables.parameters_with_law(joint, model)
    titles = (
        "What the residual of the refitted model depends on",
        "What remains after the effects",
    )
    # Without an accepted effect there is no second map.
    for title, residual_map in zip(titles, result.maps, strict=False):
        yield result_tables.residual(title, residual_map.to_list())
    as_given = [(result.model.name, found["given_model"])]
    yield result_tables.errors("The model as it was given", as_given)
    yield from _logs(logs)


def _of_addition(result: Addition, found: Found, logs: Sequence[Log]) -> Iterator[Part]:
    """The parts of the web page: the verdict first, then its reasons."""
    from identification.fitting.misfit import misfit_warning, stated_estimates

    sizes = (found["after"]["force_error"], found["noise_floor"]["force_error"])
    misfit = found.get("misfit") or misfit_warning(*sizes)
    yield Words([result.summary(), found["words"]], "verdict")
    yield Words([*([misfit] if misfit else []), *found["reasons"]], "warning")
    charts = result.drawn()
    yield Charts([charts.pop("errors")])
    yield result_tables.addition_errors(found)
    yield Charts([charts.pop("forces_0")])
    yield from _symbols(result.model)
    yield from groups_of(charts)
    model = stated_estimates(result.model, fits=not misfit)
    yield result_tables.parameters(model, "Refitted parameters")
    effects = tuple(result.model.effects)
    yield equations_with(result.model.mechanism.name, effects, [result.effect])
    yield from _logs(logs)
