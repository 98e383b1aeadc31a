"""Many blind trials: planned, run in several processes, saved one by one, and resumed."""

from __future__ import annotations

import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from identification.fitting.clocks import placed_on_clock
from identification.fitting.errors import SumsOfSquares, add_up, velocity_traces
from identification.logs.log import Log
from identification.logs.reading import read_logs
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.physical_parameters import StatedParameters
from youbot_env.files import write_json
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.base import motion_from_dict
from youbot_env.physics.effect import CATALOGUE as REGISTERED
from youbot_scripts.blind_bench.cases import (
    Case,
    draw_case,
    log_along,
    tick,
    true_velocity_error,
    unseen_log,
    write_case,
)
from youbot_scripts.blind_bench.effects import CATALOGUE, EVERYTHING, LAWS
from youbot_scripts.shared.results_folder import failure, resumed

SINGLES = ("one", "quarter", "double_noise", "sweep")
"""Kinds that go through the effects of the catalogue."""

Record = dict[str, Any]
"""What is kept of a trial, JSON-able: ``case``, ``found`` (the diagnosis's own JSON),
``carriers``, ``base`` and ``sizes`` (what the diagnosis states of the base parameters and of the
effects), ``true_velocity_error``, ``seconds``; ``identify``, what `identify` says of the same logs;
``unseen``, see `unseen_errors`; ``after``, the diagnosis with the proposed experiment;
``baseline``, what the baseline names; ``library_warnings``, in words. Where something failed:
``error``, its ``error_class`` and the line of code that raised it, ``raised_at``.
"""

Diagnose = Callable[..., Any]
"""diagnose(model, logs, seed=...), whose result has ``to_dict`` as the design fixes it."""

Identify = Callable[..., Any]
"""identify(logs, seed=...), whose result has a ``model``."""


Baseline = Callable[..., Any]
"""baseline(model, logs, seed=...), whose result's ``to_dict`` has ``verdict`` and ``missing``."""


@dataclass(frozen=True)
class Options:
    """What is done with each case beside the diagnosis.

    Attributes
    ----------
    identify : also identify the base model on the logs, or None
    follow_up : record the experiment that is proposed for a tie, and diagnose again
    keep : folder for the logs, truth.json and trial.json of each case, in a folder by its key
    limit : time [s] after which each of the two is given up with a TimeoutError; 0: never
    baseline : also let this name what is missing, on the same logs
    """

    identify: Identify | None = None
    baseline: Baseline | None = None
    follow_up: bool = False
    keep: Path | None = None
    limit: float = 0.0


def true_model(case: Case) -> Model | None:
    """The true model of a case; None if a planted effect is not in the catalogue."""
    model = load_model("paper").with_values(case.platform)
    for item in case.planted:
        # No one model holds what acts in some logs only.
        if item.name not in REGISTERED or item.logs:
            return None
        model = model.with_effect(item.name, **item.values)
    return model


def velocity_error(model: Model, logs: Sequence[Log]) -> float:
    """Velocity error of a model's free run over all logs."""
    mechanism = Mecanum(model.geometry, model.structure)
    runs = (
        velocity_traces(mechanism, model.theta, samples) for samples in mechanism.samples_of(logs)
    )
    return add_up(map(SumsOfSquares.of, runs)).ratio


def unseen_errors(case: Case, found: Any) -> dict[str, float] | None:
    """Velocity errors of free runs on a run that the diagnosis has not seen: of the refitted base
    model, with the proposed law, and of the true platform. None where no law is proposed, or none
    is wanted."""
    proposal = getattr(found, "proposal", None)
    if proposal is None or not any(item.name in LAWS for item in case.planted):
        return None
    base = found.steps[0].fitted
    fits = {"base": (base.mechanism, base.theta), "law": (proposal.mechanism, proposal.theta)}
    (samples,) = base.mechanism.samples_of([unseen_log(case)])
    # Of a law on a clock of its own the true platform knows when the run began.
    runs = {
        key: velocity_traces(*pair, *placed_on_clock(*pair, [samples]))
        for key, pair in fits.items()
    }
    errors = {key: SumsOfSquares.of(run).ratio for key, run in runs.items()}
    truth = true_velocity_error(
        *(case, samples.wheel_speed, samples.torque, samples.dt, samples.pose[0])
    )
    return errors | {"truth": truth}


def stated_sizes(found: Any, report: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Value and std of the accepted effects' parameters as they are told, by
    ``effect.parameter``: beside a proposed law those that are fitted with it."""
    told = getattr(found, "told", None)
    if isinstance(told, Model | StatedParameters):
        effects = {
            name: {key: (estimate.value, estimate.std) for key, estimate in values.items()}
            for name, values in told.effects.items()
            if name in found.model.effects
        }
    else:
        effects = {
            row["effect"]: {
                key: (value.get("value"), value.get("std"))
                for key, value in (row.get("parameters") or {}).items()
                if isinstance(value, dict)
            }
            for row in report.get("candidates", [])
            if row["effect"] in report["missing"]
        }
    return {
        f"{name}.{key}": {"value": float(value), "std": float(std)}
        for name, values in effects.items()
        for key, (value, std) in values.items()
        if value is not None and std is not None
    }


def experiment(case: Case, proposed: Mapping[str, Any]) -> Log:
    """The log of a proposed motion on the case's own platform."""
    motion = motion_from_dict(proposed["motion"])
    dt, _ = tick(case.rate)
    twist = motion.twist(dt * np.arange(round(motion.duration / dt) + 1))
    return log_along(case, "next_experiment", twist)


def stated_base(model: Any) -> dict[str, dict[str, float | None]]:
    """Value and std (None: withdrawn) of the base parameters of a fit; {} of none."""
    if not isinstance(model, Model | StatedParameters):
        return {}
    return {
        name: {"value": estimate.value, "std": estimate.std}
        for name, estimate in model.parameters.items()
    }


@contextmanager
def within(limit: float) -> Iterator[None]:
    """Raise TimeoutError in what runs longer than ``limit`` [s]; 0, or without signals: never."""
    if not limit or not hasattr(signal, "setitimer"):
        yield
        return

    def give_up(number: int, frame: object) -> None:
        raise TimeoutError(f"no answer in {limit:g} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def kept_warnings(record: Record) -> Iterator[None]:
    """Keep what libraries warn of in a record, once each, instead of on the terminal."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        finally:
            said = {f"{item.category.__name__}: {item.message}" for item in caught}
            record["library_warnings"] = sorted(said)


def run_trial(case: Case, diagnose: Diagnose, options: Options = Options()) -> Record:
    """Make a case's logs and have them diagnosed, starting from the published model.

    The logs are written and read, with the checks and repairs that a user's logs meet. An
    exception becomes a part of the record, so that it does not stop other trials.
    """
    record: Record = {
        "case": case.to_dict(),
        "carriers": sorted({c for item in case.planted for c in EVERYTHING[item.name].carriers}),
        "seconds": 0.0,
    }
    with tempfile.TemporaryDirectory() as scratch:
        folder = (options.keep or Path(scratch)) / case.key
        paths = write_case(folder, case)
        try:
            with kept_warnings(record):
                logs = read_logs(paths)
                if options.identify is not None:
                    record["identify"] = _identified(logs, case.seed, options)
                if options.baseline is not None:
                    record["baseline"] = _named_by_baseline(logs, case.seed, options)
                with within(options.limit):
                    _diagnosed(record, case, logs, diagnose, options.follow_up)
        except Exception as error:
            record |= failure(error)
        if options.keep is not None:
            write_json(folder / "trial.json", record)
    return record


def _identified(logs: Sequence[Log], seed: int, options: Options) -> Record:
    assert options.identify is not None
    before = time.perf_counter()
    try:
        with within(options.limit):
            found = {"base": stated_base(options.identify(logs, seed=seed).model)}
    except Exception as error:
        found = failure(error)
    return found | {"seconds": time.perf_counter() - before}


def _named_by_baseline(logs: Sequence[Log], seed: int, options: Options) -> Record:
    assert options.baseline is not None
    try:
        with within(options.limit):
            return options.baseline(load_model("paper"), logs, seed=seed).to_dict()
    except Exception as error:
        return failure(error)


def _diagnosed(
    record: Record, case: Case, logs: Sequence[Log], diagnose: Diagnose, follow_up: bool
) -> None:
    """Add to a record what the diagnosis of a case's logs says, and what is true."""
    before = time.perf_counter()
    try:
        found = diagnose(load_model("paper"), logs, seed=case.seed)
    finally:
        record["seconds"] = time.perf_counter() - before
    record["found"] = found.to_dict()
    record["base"] = stated_base(getattr(found, "told", None))
    record["sizes"] = stated_sizes(found, record["found"])
    record["unseen"] = unseen_errors(case, found)
    truth = true_model(case)
    record["true_velocity_error"] = None if truth is None else velocity_error(truth, logs)
    proposed = record["found"].get("next_experiment")
    if follow_up and proposed and record["found"]["ambiguous_with"]:
        more = [*logs, experiment(case, proposed)]
        record["after"] = diagnose(load_model("paper"), more, seed=case.seed).to_dict()


@dataclass(frozen=True)
class Spec:
    """What makes a case: see :func:`youbot_scripts.blind_bench.cases.draw_case`."""

    kind: str
    index: int
    seed: int
    rate: float | None = None
    noise: float | None = None

    def draw(self) -> Case:
        """The case."""
        return draw_case(self.kind, self.index, self.seed, self.rate, self.noise)


def plan(
    kinds: Sequence[str],
    cases: int,
    seed: int,
    rates: Sequence[float] = (),
    noise: float | None = None,
    first: int = 0,
) -> list[Spec]:
    """``cases`` cases of each kind, the kinds in turn, so that the first cases cover all kinds.

    Parameters
    ----------
    rates : of the logs [Hz], in turn; empty: as each kind has it
    noise : factor on the base noise; None: as each kind has it
    first : index of each kind's first case

    Raises
    ------
    InputError
        If a kind or rate cannot be.
    """
    columns = []
    for kind in kinds:
        # All effects at one rate before the next rate, so that every effect is tried at every rate.
        turn = len(CATALOGUE) if kind in SINGLES else 1
        columns.append(
            [
                Spec(kind, i, seed, rates[i // turn % len(rates)] if rates else None, noise)
                for i in range(first, first + cases)
            ]
        )
        if cases:
            # Draws one case, so that an unknown kind or rate is refused before the work begins.
            columns[-1][0].draw()
    return [spec for spec in chain.from_iterable(zip_longest(*columns)) if spec is not None]


def try_case(diagnose: Diagnose, options: Options, spec: Spec) -> Record:
    """One trial of the case that a spec makes."""
    return run_trial(spec.draw(), diagnose, options)


def run_trials(
    specs: Sequence[Spec],
    diagnose: Diagnose,
    *,
    jobs: int = 1,
    folder: Path | None = None,
    options: Options = Options(),
    progress: Callable[[], None] = lambda: None,
) -> list[Record]:
    """Trials of all cases, in their order.

    Parameters
    ----------
    diagnose : ``diagnose(model, logs, seed=...)``; picklable if ``jobs`` is more than one
    options : what is done beside the diagnosis; picklable if ``jobs`` is more than one
    folder : where each trial is saved when it is done; trials in it are not run again

    Raises
    ------
    InputError
        If the folder cannot be made or holds something else.
    """
    keys = {spec: spec.draw().key for spec in specs}
    done = resumed(
        partial(try_case, diagnose, options),
        {key: spec for spec, key in keys.items()},
        lambda record: record["case"]["key"],
        jobs=jobs,
        folder=folder,
        progress=progress,
    )
    return [done[keys[spec]] for spec in specs]


def errors_of(records: Iterable[Record]) -> list[str]:
    """What went wrong, by case."""
    return [f"{r['case']['key']}: {r['error']}" for r in records if "error" in r]
