"""A run of `youbot benchmark`: what was asked for, what was measured, its tables and pictures."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.recording import record
from identification import diagnose, identify
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration
from youbot_env.motions.multisine import multisine
from youbot_scripts.benchmarks.learning import LearningSpeed, learning_speeds
from youbot_scripts.benchmarks.simulators import Simulator, SimulatorSettings, simulators
from youbot_scripts.benchmarks.speed import (
    Speed,
    SpeedSettings,
    import_times,
    machine,
    single_precision_errors,
    speeds,
)
from youbot_scripts.shared.tables import Column, Table, columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PARTS = ("steps", "simulators", "logs", "training", "imports")


def usual_parts(quick: bool) -> tuple[str, ...]:
    """Parts that are measured unless others are asked for: all that the installed extras allow."""
    if quick:
        return ("steps", "simulators")
    learns = importlib.util.find_spec("stable_baselines3") is not None
    return tuple(part for part in PARTS if learns or part != "training")


IMPORTED = ("youbot_env", "identification", "controllers")

UNITS = {"twist": "m/s, rad/s", "pose": "m, rad", "wheel_angle": "rad", "reward": "1"}


@dataclass(frozen=True)
class Sizes:
    """What to measure, and how long.

    Attributes
    ----------
    parts : of ``PARTS``
    copies, threads, effects : of the batches
    quick : few, short turns; medians of fewer
    log_seconds, diagnosed : lengths of the logs [s]; the longest that is diagnosed
    """

    parts: Sequence[str]
    copies: Sequence[int]
    threads: Sequence[int]
    effects: Sequence[int]
    quick: bool = False

    @property
    def log_seconds(self) -> tuple[float, ...]:
        """Lengths of the multisines beside the calibration motions."""
        return (60.0,) if self.quick else (60.0, 240.0, 960.0)

    @property
    def diagnosed(self) -> float:
        """The longest multisine that is diagnosed; quickly none is."""
        return 0.0 if self.quick else 240.0


@dataclass(frozen=True)
class LogTime:
    """A row: seconds of work on logs of ``seconds_of_log``; None where it was not tried."""

    seconds_of_log: float
    rows: int
    identify: float
    diagnose: float | None

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def log_times(lengths: Sequence[float], diagnosed: float) -> list[LogTime]:
    """For the calibration motions and multisines of these lengths [s] at 100 Hz.

    Diagnosed are those of at most ``diagnosed`` [s]. The first logs are identified once before, so
    that nothing is compiled while the clock runs.
    """
    model, found = load_model("paper"), []
    motions = [multisine(np.random.default_rng(1), duration=length) for length in lengths]
    first, *others = record(model, [calibration(), *motions])
    identify([first, others[0]])
    for length, log in zip(lengths, others, strict=True):
        logs = [first, log]
        judged = None
        if length <= diagnosed:
            judged = _seconds(lambda logs=logs: diagnose(model, logs))
        rows = sum(len(one.time) for one in logs)
        fitted = _seconds(lambda logs=logs: identify(logs))
        found.append(LogTime(rows / 100.0, rows, fitted, judged))
    return found


def _seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


@dataclass(frozen=True)
class Benchmark:
    """What a run has measured; a part that was not asked for is empty."""

    speeds: Sequence[Speed] = ()
    single_precision: dict[str, float] = field(default_factory=dict)
    simulators: Sequence[Simulator] = ()
    logs: Sequence[LogTime] = ()
    training: Sequence[LearningSpeed] = ()
    imports: dict[str, float] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            "speeds": [row.to_dict() for row in self.speeds],
            "single_precision": self.single_precision,
            "simulators": [row.to_dict() for row in self.simulators],
            "logs": [row.to_dict() for row in self.logs],
            "training": [row.to_dict() for row in self.training],
            "import_seconds": self.imports,
            "machine": self.machine,
        }


def measure(sizes: Sizes) -> Benchmark:
    """One run."""
    steps, others = SpeedSettings(), SimulatorSettings()
    if sizes.quick:
        steps = SpeedSettings(steps=4000, most_calls=100, warm_up=20)
        others = SimulatorSettings(rounds=3, steps=10)
    asked = sizes.parts
    return Benchmark(
        speeds=speeds(sizes.copies, sizes.threads, sizes.effects, steps)
        if "steps" in asked
        else (),
        single_precision=single_precision_errors() if "steps" in asked else {},
        simulators=simulators(others) if "simulators" in asked else (),
        logs=log_times(sizes.log_seconds, sizes.diagnosed) if "logs" in asked else (),
        training=learning_speeds() if "training" in asked else (),
        imports=import_times(IMPORTED) if "imports" in asked else {},
        machine=machine(),
    )


def tables(found: Benchmark) -> list[Table]:
    """A table of each part that was measured."""
    shown = []
    if found.speeds:
        shown += [_speeds(found.speeds), _errors(found.single_precision)]
    if found.simulators:
        shown.append(_simulators(found.simulators))
    if found.logs:
        shown.append(_logs(found.logs))
    if found.training:
        shown.append(_training(found.training))
    if found.imports:
        seconds = Column("seconds", lambda value: f"{value:.2f}")
        rows = tuple(found.imports.items())
        shown.append(Table("In a new Python", columns("what", seconds), rows))
    return shown


def _speeds(found: Sequence[Speed]) -> Table:
    ratio = Column("times\nas fast", lambda value: f"{value:.2f}")
    million = Column("M\nsteps/s", lambda rate: f"{rate / 1e6:.2f}")
    peer = Column("peer's", lambda rate: f"{rate / 1e6:.2f}")
    rows = tuple(
        (
            *(row.case, row.copies, row.threads, row.effects, row.ratio, row.rate, row.peer_rate),
            "" if row.bytes_a_copy is None else str(row.bytes_a_copy),
        )
        for row in found
    )
    first = Column("case")  # not wrapped
    others = columns("copies", "threads", "effects", ratio, million, peer, "B a\ncopy")
    shown = (first, Column("copies"), *others[1:])
    notes = ("batches: beside Gymnasium's NumPy CartPole of as many copies",)
    return Table("Full environment steps beside Gymnasium's, in turns", shown, rows, notes)


def _errors(found: dict[str, float]) -> Table:
    largest = Column("largest", lambda value: f"{value:.1e}")
    rows = tuple((name, value, UNITS.get(name, UNITS["twist"])) for name, value in found.items())
    title = "Single less double precision over 10 s"
    return Table(title, columns("of", largest, "unit"), rows)


def _simulators(found: Sequence[Simulator]) -> Table:
    ratio = Column("full batch is\ntimes as fast", lambda value: f"{value:.3g}")
    rate = Column("simulated\nseconds/s", lambda value: f"{value:,.0f}")
    contact = Column("times as fast\nas MuJoCo", lambda value: f"{value:,.0f}" if value else "-")
    rows = tuple((row.name, row.platforms, row.ratio, row.by_contact, row.rate) for row in found)
    title = "Simulated time on one thread: full environments and bare dynamics"
    return Table(title, columns("what", "platforms", ratio, contact, rate), rows)


def _logs(found: Sequence[LogTime]) -> Table:
    seconds = [Column(name, lambda value: f"{value:.2f}") for name in ("identify", "diagnose")]
    rows = tuple(
        (f"{row.seconds_of_log:.0f} s", row.rows, row.identify, row.diagnose or "-")
        for row in found
    )
    return Table("Seconds by the length of the logs", columns("logs", "rows", *seconds), rows)


def _training(found: Sequence[LearningSpeed]) -> Table:
    ratio = Column("times\nas fast", lambda value: f"{value:.2f}")
    rate = Column("steps/s\nof a core", lambda value: f"{value:,.0f}")
    rows = tuple(
        (
            *(row.name, row.copies, row.a_round, row.batch, row.epochs),
            *(found[0].rate / row.rate, row.rate),
        )
        for row in found
    )
    shown = columns("copies in", "copies", "a round", "batch", "epochs", ratio, rate)
    notes = ("times as fast: the first row's rate by this one's",)
    return Table("PPO, environment steps with learning", shown, rows, notes)


def figures(found: Benchmark) -> list[tuple[str, Figure]]:
    """Named pictures: steps a second against copies, time against length; needs matplotlib."""
    shown = []
    if any(row.copies > 1 for row in found.speeds):
        shown.append(("steps_by_copies", _steps_by_copies(found.speeds)))
    if found.logs:
        shown.append(("seconds_by_length", _seconds_by_length(found.logs)))
    return shown


def _steps_by_copies(found: Sequence[Speed]) -> Figure:
    from identification.figures.style import GREY, new_figure, style

    with style():
        figure = new_figure(4.5)
        axes = figure.subplots()
        lines: dict[tuple[str, int], list[Speed]] = {}
        for row in found:
            if row.case.startswith("batch") and not row.effects:
                lines.setdefault((row.case, row.threads), []).append(row)
        for n, ((case, threads), rows) in enumerate(lines.items()):
            label = f"{case}, {threads} thread" + ("s" if threads > 1 else "")
            x, y = [row.copies for row in rows], [row.rate for row in rows]
            axes.plot(x, y, marker="osD^"[n % 4], label=label)
        first = next(iter(lines.values()))
        peers = [row.peer_rate for row in first]
        label = "CartPole, NumPy"
        axes.plot([row.copies for row in first], peers, color=GREY, linestyle="dashed", label=label)
        axes.set(xscale="log", yscale="log", xlabel="copies", ylabel="environment steps a second")
        axes.set_title("Steps a second, full environment")
        axes.legend()
    return figure


def _seconds_by_length(found: Sequence[LogTime]) -> Figure:
    from identification.figures.style import new_figure, style

    with style():
        figure = new_figure(3.5)
        axes = figure.subplots()
        axes.plot([r.rows for r in found], [r.identify for r in found], "o-", label="identify")
        judged = [(r.rows, r.diagnose) for r in found if r.diagnose is not None]
        if judged:
            axes.plot(*zip(*judged, strict=True), "s-", label="diagnose")
        axes.set(xscale="log", yscale="log", xlabel="rows of the logs", ylabel="seconds")
        axes.set_title("Time against the length of the logs")
        axes.legend()
    return figure


def draw(found: Benchmark, folder: Path) -> list[Path]:
    """Write the pictures into a folder."""
    from identification.figures.style import write_figures

    return write_figures(folder, figures(found))
