"""The folder of a run: what was asked for, the last checkpoint, the best policy.

Checkpoints are read with torch's ``weights_only``, so resuming a run from elsewhere runs no code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from youbot_env.errors import InputError
from youbot_env.files import atomic_path
from youbot_env.model.model import Model
from youbot_env.model.model_file import model_from_dict, model_to_dict
from youbot_scripts.shared import options as common
from youbot_scripts.training.settings import Choice, choice_from_dict


@dataclass(frozen=True)
class RunFolder:
    """Files of one run in the folder ``path``."""

    path: Path

    @property
    def settings(self) -> Path:
        """What was asked for: JSON, written once."""
        return self.path / "run.json"

    @property
    def checkpoint(self) -> Path:
        """The learner as it was at the last evaluation."""
        return self.path / "checkpoint.pt"

    @property
    def replay(self) -> Path:
        """What SAC and TD3 have seen; the checkpoint is worth little without it."""
        return self.path / "replay.pt"

    @property
    def policy(self) -> Path:
        """Description of the best policy so far."""
        return self.path / "policy.json"

    def begin(self, choice: Choice, model: Model, command: str) -> None:
        """Write down what was asked for.

        Raises
        ------
        InputError
            If the folder holds a run already or cannot be written.
        """
        if self.settings.exists():
            raise InputError(
                f"{self.path}: holds a run already; continue it with --resume, or name another "
                "--output"
            )
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"{self.path}: cannot be made a folder: {reason}") from None
        asked = {"choice": choice.to_dict(), "model": model_to_dict(model), "command": command}
        common.write_json(self.settings, asked)

    def asked(self) -> tuple[Choice, Model, str]:
        """Choice, model and command of a run that was begun.

        Raises
        ------
        InputError
            If there is none.
        """
        try:
            data = json.loads(self.settings.read_text("utf-8"))
            choice, command = choice_from_dict(data["choice"]), str(data["command"])
            return choice, model_from_dict(data["model"], str(self.settings)), command
        except OSError:
            raise InputError(f"{self.path}: holds no run to resume (no run.json)") from None
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"{self.settings}: cannot be resumed: {error}") from None

    def save(self, state: Mapping[str, Any], replay: Mapping[str, Any] | None) -> None:
        """Write a checkpoint: complete or not at all. The replay comes first."""
        for path, content in ((self.replay, replay), (self.checkpoint, state)):
            if content is not None:
                with atomic_path(path) as stand_in:
                    torch.save(dict(content), stand_in)

    def load(self) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
        """The last checkpoint and replay, None where there is none yet.

        Raises
        ------
        InputError
            If a file is damaged or holds more than numbers.
        """
        return _tensors(self.checkpoint), _tensors(self.replay)


def _tensors(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: no checkpoint of a run: {reason[:120]}") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: no checkpoint of a run")
    return found
