"""Show the whole story on shipped logs."""

from __future__ import annotations

import importlib.util
import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_scripts import cli
from youbot_scripts.shared.options import console
from youbot_scripts.shared.tables import Column, Table, columns, number, show, text, with_std

if TYPE_CHECKING:
    from rich.console import Console


LOGS = ("calibration.csv.gz", "multisine_a.csv.gz", "multisine_b.csv.gz", "record.json")
"""Shipped files: logs of the paper's platform, driven in simulation, and how they were made."""

HIDDEN = ("hidden/calibration.csv.gz", "hidden/multisine_a.csv.gz", "hidden/record.json")
"""The same platform where something is different; `record.json` gives it away."""


@dataclass(frozen=True)
class Story:
    """Where a demo prints and where its files are: what one step leaves for the next."""

    out: Console
    folder: Path

    @property
    def calibration(self) -> Path:
        """Log that the model is fitted to."""
        return self.folder / "logs" / "calibration.csv.gz"

    @property
    def held_out(self) -> Path:
        """Log that the fit does not see."""
        return self.folder / "logs" / "multisine_b.csv.gz"

    @property
    def elsewhere(self) -> tuple[Path, Path]:
        """Logs in which an effect is hidden."""
        folder = self.folder / "logs"
        return folder / HIDDEN[0], folder / HIDDEN[1]

    @property
    def model(self) -> Path:
        """The identified model's file."""
        return self.folder / "model.json"

    @property
    def better(self) -> Path:
        """The file of the model with what was found missing."""
        return self.folder / "better.json"

    @property
    def plots(self) -> tuple[str | Path, ...]:
        """Option that draws the figures; none without matplotlib, an extra."""
        if importlib.util.find_spec("matplotlib") is None:
            return ()
        return ("--plots", self.folder / "plots")

    def tell(self, text: str) -> None:
        """Print a paragraph, wrapped at the terminal's width."""
        self.out.print(text)

    def command(self, *arguments: str | Path) -> None:
        """Show a command as a user would type it, and run it here."""
        typed = [str(argument) for argument in arguments]
        self.out.print(f"$ youbot {shlex.join(typed)}", style="bold", soft_wrap=True)
        status = cli.main(typed)
        if status != cli.OK:
            raise typer.Exit(status)  # the command has said why

    def result_of(self, *arguments: str | Path, to: str) -> dict[str, Any]:
        """Run a command that writes its result to the JSON file `to`, and read that."""
        path = self.folder / to
        self.command(*arguments, "--json", path)
        return json.loads(path.read_text("utf-8"))

    def secret(self) -> list[str]:
        """What is hidden in the logs of ``elsewhere``, as `--effect` of other commands takes it."""
        record = json.loads((self.calibration.parent / HIDDEN[2]).read_text("utf-8"))
        return [
            f"{effect}:"
            + ",".join(f"{p}={held['value']!r}" for p, held in of["parameters"].items())
            for effect, of in record["plant"]["effects"].items()
        ]


def unpack(story: Story) -> None:
    """Put the shipped logs where the commands can be typed again.

    Raises
    ------
    InputError
        If the folder cannot be made, written to, or named in a command.
    """
    from youbot_env.errors import InputError
    from youbot_env.files import write_atomically

    folder = story.calibration.parent
    if "," in str(story.folder):
        raise InputError(f"{story.folder}: a comma would part it in a list of models; name another")
    try:
        (folder / "hidden").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    shipped = resources.files("youbot_scripts").joinpath("data")
    for name in (*LOGS, *HIDDEN):
        write_atomically(folder / name, shipped.joinpath(name).read_bytes())


EXAMPLES = ("youbot demo", "youbot demo --output /tmp/demo")

CONTROLLERS = ("kinematic", "kinematic_tuned", "computed_torque", "ppo")
"""Compared in the last chapter; they need no extra."""


def main(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for what it writes.")
    ] = Path("demo_output"),
) -> None:
    """From logs to a model, from where it fails to what it lacks, and to a controller built on it.

    Each step is a youbot command, shown as you would type it. The logs (50 Hz) come from a
    simulated platform with the paper's parameters, so the truth is known. Half a minute on an idle
    core; twice that where the simulations have to be compiled first.
    """
    story = Story(console(), output)
    unpack(story)
    for chapter, (title, step) in enumerate(STEPS.items(), 1):
        _heading(story.out, f"{chapter}. {title}")
        step(story)
    finish(story)


def _heading(out: Console, title: str) -> None:
    out.print()
    out.rule(title, align="left", style="default")


def check(story: Story) -> None:
    """What is in the logs, and what they can show."""
    story.command("doctor", story.calibration, story.held_out)


def identify(story: Story) -> None:
    """Fit the seven parameters to the calibration run."""
    story.tell(
        "The paper's motions I, III, II and IV, 35 s each, under the platform's stock wheel-speed "
        "control."
    )
    story.command("identify", story.calibration, "-o", story.model, *story.plots)
    story.tell(
        "A rank below 7 means that a motion is blind to the sums of x in its row: only together "
        "do the motions tell all parameters apart."
    )


def judge(story: Story) -> None:
    """The estimates beside the parameters that the logs were simulated with."""
    from youbot_env.model.model_file import load_model

    found, true = load_model(story.model), load_model("paper")
    rows = []
    for name, estimate in found.parameters.items():
        truth, std = true.parameters[name].value, estimate.std or float("nan")
        off = (estimate.value - truth) / std
        rows.append((name, truth, with_std(estimate.value, std), off, estimate.unit))
    shown = (Column("true", number), "identified ± std", Column("off by (std)", "{:+.1f}".format))
    headers = columns("name", *shown, text("unit"))
    show(story.out, [Table("Against the truth", headers, tuple(rows))])
    inside = sum(abs(float(row[3])) <= 1.96 for row in rows)
    story.tell(f"{inside} of {len(rows)} true values lie within ± 1.96 std (95 % are expected to).")


def compare(story: Story) -> None:
    """The model on a multisine that the fit has not seen."""
    story.tell("A velocity multisine of 0.5 to 3 rad/s, kept aside until now.")
    found = story.result_of("compare", story.model, story.held_out, *story.plots, to="compare.json")
    error, floor = (found[key]["velocity_error"] for key in ("total", "noise_floor"))
    story.tell(
        f"Driven by the measured torques alone for a minute, the model is {100 * error:.2f} % off "
        f"the measured velocities; noise alone makes {100 * floor:.2f} %. "
        + ("Nothing is missing from it." if error < 1.2 * floor else "Something is missing.")
    )


def fail(story: Story) -> None:
    """The same model on logs in which an effect is hidden."""
    story.tell("The same robot in another room. Nobody has told the model what is different there.")
    story.command("compare", story.model, *story.elsewhere)


def diagnose(story: Story) -> None:
    """What is different, named; the error falls."""
    found = story.result_of(
        "diagnose", story.model, *story.elsewhere, "-o", story.better, to="diagnosis.json"
    )
    first, last = found["steps"][0], found["steps"][-1]
    story.tell(
        f"The held-out velocity error falls from {100 * first['velocity_error']:.1f} % to "
        f"{100 * last['velocity_error']:.1f} %, where noise alone would leave "
        f"{100 * found['noise_floor']['velocity_error']:.1f} %."
    )


def drive(story: Story) -> None:
    """Controllers where the model failed: on that model, and on the one with what it lacked."""
    story.tell(
        "Controllers in that other room, each on the model from before the diagnosis and on the "
        "one from after it, along references that they have not seen, from noisy encoders and a "
        "sample late: the stock wheel-speed control, the same tuned on the model, computed torque, "
        "and a policy that was trained where the floor is flat."
    )
    found = story.result_of(
        "evaluate",
        *(word for effect in story.secret() for word in ("--effect", effect)),
        *("--model", f"{story.model},{story.better}"),
        *("--controllers", ",".join(CONTROLLERS)),
        *("--bands", "0.5-1,1-2,2-4", "--seeds", "3", "--duration", "10"),
        *("--brief", "--jobs", "1"),  # so short that a second process would start too late
        *story.plots,
        to="evaluation.json",
    )
    before, after = (
        _error(found, "computed_torque", model) for model in (story.model, story.better)
    )
    tuned = _error(found, "kinematic_tuned", story.better)
    story.tell(
        f"Computed torque misses {100 * before:.2f} % of the reference on the model that is blind "
        f"to the slope, and {100 * after:.2f} % on the one that knows it; the tuned kinematic "
        f"control {100 * tuned:.1f} %."
    )


def _error(found: dict[str, Any], controller: str, model: Path) -> float:
    """Mean normalised RMSE over axes, seeds and bands."""
    errors = [
        result["metrics"]["nrmse"]["mean"]
        for result in found["results"]
        if (result["controller"], result["model"]) == (controller, str(model))
    ]
    return sum(errors) / len(errors)


STEPS = {
    "Are the logs sound, and what can they show?": check,
    "Identify the model from the calibration run": identify,
    "Is that the truth? (Simulated logs: it is known)": judge,
    "Does the model predict a run that it has not seen?": compare,
    "Does it hold in another room?": fail,
    "What is missing?": diagnose,
    "Does a better model drive better?": drive,
}
"""The story, in order: title and step of each chapter."""


def finish(story: Story) -> None:
    """Where everything is, and what to type next."""
    out, folder = story.out, story.folder
    _heading(out, "What there is now")
    _show_files(out, folder)
    if not story.plots:
        out.print('No plots without matplotlib: pip install "youbot[plots]"')
    out.print("\nWhat to type next:")
    for line, why in _next(story):
        out.print(f"  {why}:")
        out.print(f"    {line}", style="bold", soft_wrap=True)


def _show_files(out: Console, folder: Path) -> None:
    out.print(f"{folder.resolve()}", soft_wrap=True)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            out.print(f"  {path.relative_to(folder)}", soft_wrap=True)


def _next(story: Story) -> Sequence[tuple[str, str]]:
    logs, model = story.calibration.parent, shlex.quote(str(story.model))
    both = f"{shlex.quote(str(story.calibration))} {shlex.quote(str(logs / LOGS[1]))}"
    return (
        (f"youbot identify {both} -o better.json", "Fit to two logs at once"),
        ("youbot record runs/ --effect floor_tilt", "Record a platform on a slope"),
        (f"youbot compare {model} runs/multisine_b.csv", "... and see the model fail on it"),
        ("youbot evaluate", 'Compare more controllers, band by band; needs "youbot[control]"'),
        (f"youbot train ppo --model {model}", 'Train a policy on the model; needs "youbot[rl]"'),
        ("youbot doctor my_log.csv", "Check a log of your own"),
    )


if __name__ == "__main__":
    sys.exit(cli.run_script(__file__))
