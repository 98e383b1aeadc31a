"""Tools that answer a blind set: the diagnosis, and three baselines of the literature."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from identification.mechanisms.mechanism import Mechanism
from youbot_env.errors import InputError
from youbot_env.files import write_atomically, write_json
from youbot_env.model.model_file import load_model
from youbot_env.physics.geometry import WHEELS
from youbot_scripts.blind_bench.baseline import stepwise
from youbot_scripts.blind_bench.claims import Claim, read_claims, write_claims
from youbot_scripts.blind_bench.discrepancy import boosted_residual, sparse_regression
from youbot_scripts.blind_bench.published import Published
from youbot_scripts.shared.workers import spread

Array = NDArray[np.float64]

ROUNDS = 3
"""Passes in which torques are predicted from a motion: some effects read the torques themselves."""


@dataclass(frozen=True)
class Answered:
    """A claim, and the torques (N, 4) [N m] predicted for the unseen motion; None: none."""

    claim: Claim
    effort: Array | None = None


Tool = Callable[[Sequence[Log], Log, int], Answered]
"""tool(logs, motion, seed): what the logs lack, and the torques that drive a motion."""


def torques_of(mechanism: Mechanism[Any], theta: Array, motion: Log) -> Array:
    """(N, 4) torques that a model predicts for a motion."""
    split = np.linalg.pinv(mechanism.jacobian)
    effort = np.zeros_like(motion.effort)
    for _ in range(ROUNDS):
        (samples,) = mechanism.samples_of([replace(motion, effort=effort)])
        starts, ends = mechanism.demand(theta, samples).force
        # At a row the end of one interval meets the start of the next.
        force = np.concatenate([starts[:1], 0.5 * (starts[1:] + ends[:-1]), ends[-1:]])
        effort = np.zeros_like(motion.effort)
        effort[-len(force) :] = (force / mechanism.force_scale) @ split
    return effort


def by_diagnosis(logs: Sequence[Log], motion: Log, seed: int) -> Answered:
    """`youbot diagnose`, with the law that it proposes, if any."""
    from identification.diagnosis.diagnose import diagnose

    found = diagnose(load_model("paper"), logs, seed=seed)
    ties, law = found.ambiguous_with, found.proposal
    effects = tuple((name, *ties.get(name, ())) for name in found.missing)
    if law is None:
        fitted = found.steps[-1].fitted
        return Answered(
            Claim(found.verdict, effects), torques_of(fitted.mechanism, fitted.theta, motion)
        )
    said = law.to_dict()
    told = {"site": said["site"], "variables": said["variables"], "name": said["name"]}
    effects = tuple(names for names in effects if names[0] in law.beside)
    return Answered(
        Claim(found.verdict, effects, told), torques_of(law.mechanism, law.theta, motion)
    )


def by_stepwise(logs: Sequence[Log], motion: Log, seed: int) -> Answered:
    """F-tests on a split sample with FDR control: see `baseline`."""
    found = stepwise(load_model("paper"), logs, seed=seed)
    claim = Claim(found.to_dict()["verdict"], tuple((name,) for name in found.missing))
    assert found.fitted is not None
    return Answered(claim, torques_of(found.fitted.mechanism, found.fitted.theta, motion))


def by_sparse_regression(logs: Sequence[Log], motion: Log, seed: int) -> Answered:
    """Sequentially thresholded least squares over a library, on what the base model leaves."""
    found = sparse_regression(load_model("paper"), logs)
    claim = Claim(found.verdict, tuple((name,) for name in found.effects), found.law)
    return Answered(claim, found.torques(motion))


def by_boosting(logs: Sequence[Log], motion: Log, seed: int) -> Answered:
    """Gradient-boosted trees on what the base model leaves: the error falls, nothing is named."""
    found = boosted_residual(load_model("paper"), logs, seed)
    return Answered(Claim(found.verdict), found.torques(motion))


TOOLS: dict[str, Tool] = {
    "youbot": by_diagnosis,
    "stepwise": by_stepwise,
    "sparse": by_sparse_regression,
    "boosted": by_boosting,
}
"""By name."""


def answer_set(
    published: Published,
    tool: str,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[], None] = lambda: None,
) -> Path:
    """Let a tool answer a blind set; returns its file. What it has answered before stays.

    Raises
    ------
    InputError
        If there is no such tool, or the folder holds no blind set.
    """
    if tool not in TOOLS:
        raise InputError(f"--tool: {tool!r} is none of {', '.join(TOOLS)}")
    folder = published.folder / "tools" / tool
    folder.mkdir(parents=True, exist_ok=True)
    codes = published.codes
    left = [code for code in codes if not (folder / f"{code}.json").is_file()]
    for _ in spread(partial(_answer_case, published, tool, seed), left, jobs):
        progress()
    kept = [folder / f"{code}.json" for code in codes]
    answered = [read_claims(file) for file in kept if file.is_file()]
    path = folder / "answers.json"
    write_claims(path, tool, {code: claim for one in answered for code, claim in one.items()})
    return path


def _answer_case(published: Published, tool: str, seed: int, code: str) -> None:
    folder = published.folder / "tools" / tool
    motion = published.motion(code)
    began = time.perf_counter()
    try:
        answered = TOOLS[tool](published.logs(code), motion, seed)
    except Exception as error:  # a tool that fails has answered nothing; the next case goes on
        write_json(folder / f"{code}.error.json", {"error": f"{type(error).__name__}: {error}"})
        return
    seconds, name = time.perf_counter() - began, None
    if answered.effort is not None:
        name = f"{code}.csv"
        rows = np.column_stack([motion.time, answered.effort])
        head = ",".join(["time", *(f"effort_{wheel}" for wheel in WHEELS)])
        lines = (",".join(f"{value:.9g}" for value in row) for row in rows)
        write_atomically(folder / name, "\n".join([head, *lines]) + "\n")
    claim = replace(answered.claim, predictions=name, seconds=seconds)
    write_claims(folder / f"{code}.json", tool, {code: claim})
