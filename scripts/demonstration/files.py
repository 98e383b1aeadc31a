"""A demonstration's files, and how it runs a command as a user would."""

from __future__ import annotations

import importlib.util
import json
import shlex
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from youbot_scripts import cli

if TYPE_CHECKING:
    from rich.console import Console

LOGS = ("calibration.csv.gz", "multisine_a.csv.gz", "multisine_b.csv.gz", "record.json")
"""Shipped files: logs of the paper's platform, driven in simulation, and how they were made."""

HIDDEN = ("hidden/calibration.csv.gz", "hidden/multisine_a.csv.gz", "hidden/record.json")
"""Logs of the same platform with a hidden effect, which `record.json` names."""

CARPET = ("carpet/multisine_a.csv.gz", "carpet/IV.csv.gz", "carpet/record.json")
"""Logs of the same platform with an effect that the catalogue has not."""


@dataclass(frozen=True)
class Demonstration:
    """Output and files of a demonstration; each chapter uses files of the earlier ones."""

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
    def changed_room(self) -> tuple[Path, Path]:
        """Logs in which an effect is hidden."""
        folder = self.folder / "logs"
        return folder / HIDDEN[0], folder / HIDDEN[1]

    @property
    def model(self) -> Path:
        """The identified model's file."""
        return self.folder / "model.json"

    @property
    def extended_model(self) -> Path:
        """The file of the model with what was found missing."""
        return self.folder / "better.json"

    @property
    def lab(self) -> Path:
        """Folder of the logs that look like a real robot's."""
        return self.folder / "logs" / "lab"

    @property
    def lab_logs(self) -> tuple[Path, Path]:
        """Logs that look like a real robot's."""
        return self.lab / "calibration.csv.gz", self.lab / "multisine_a.csv.gz"

    @property
    def lab_model(self) -> Path:
        """The file of the model with what those logs showed."""
        return self.folder / "lab.json"

    @property
    def carpet_logs(self) -> tuple[Path, Path]:
        """Logs in which something hides that no catalogue has."""
        folder = self.folder / "logs"
        return folder / CARPET[0], folder / CARPET[1]

    @property
    def carpet_models(self) -> tuple[Path, Path]:
        """Files of the model that those logs are fitted with, without and with the law."""
        return self.folder / "carpet.json", self.folder / "carpet_law.json"

    @property
    def law(self) -> Path:
        """The file of the law that is proposed for them."""
        return self.folder / "law.py"

    @property
    def plots(self) -> tuple[str | Path, ...]:
        """Option that draws the figures; none without matplotlib, an extra."""
        if importlib.util.find_spec("matplotlib") is None:
            return ()
        return ("--plots", self.folder / "plots")

    def say(self, text: str) -> None:
        """Print a paragraph, wrapped at the terminal's width."""
        self.out.print(text)

    def command(self, *arguments: str | Path) -> None:
        """Show a command as a user would type it, and run it here."""
        typed = [str(argument) for argument in arguments]
        self.out.print(f"$ youbot {shlex.join(typed)}", style="bold", soft_wrap=True)
        status = cli.main(typed)
        if status != cli.OK:
            raise typer.Exit(status)  # the command has printed its error

    def result_of(self, *arguments: str | Path, to: str) -> dict[str, Any]:
        """Run a command that writes its result to the JSON file `to`, and read that."""
        path = self.folder / to
        self.command(*arguments, "--json", path)
        return json.loads(path.read_text("utf-8"))

    def hidden_effects(self, record_file: str = HIDDEN[2]) -> list[str]:
        """What is hidden in the logs of ``changed_room``, or of another record, as the option
        `--effect` takes it."""
        record = json.loads((self.calibration.parent / record_file).read_text("utf-8"))
        return [
            f"{effect}:"
            + ",".join(f"{p}={held['value']!r}" for p, held in of["parameters"].items())
            for effect, of in record["plant"]["effects"].items()
        ]


def unpack(demo: Demonstration) -> None:
    """Put the shipped logs where the commands can be typed again.

    Raises
    ------
    InputError
        If the folder cannot be made, written to, or named in a command.
    """
    from youbot_env.errors import InputError
    from youbot_env.files import write_atomically

    folder = demo.calibration.parent
    if "," in str(demo.folder):
        raise InputError(f"{demo.folder}: a comma would part it in a list of models; name another")
    try:
        for room in ("hidden", "carpet"):
            (folder / room).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    shipped = resources.files("youbot_scripts").joinpath("data")
    for name in (*LOGS, *HIDDEN, *CARPET):
        write_atomically(folder / name, shipped.joinpath(name).read_bytes())
