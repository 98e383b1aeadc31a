"""The folder of a run: its settings, the last checkpoint, the best policy.

Checkpoints are read with torch's ``weights_only``, so that a file from elsewhere cannot run code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch

from youbot_env.errors import InputError
from youbot_env.files import FileKind, Schema, atomic_path, read_json
from youbot_env.model.model import Model
from youbot_env.model.model_file import model_from_dict, model_to_dict
from youbot_scripts.shared import options as common
from youbot_scripts.training.conditions import Conditions
from youbot_scripts.training.settings import (
    MOST_ENVS,
    MOST_STEPS,
    Choice,
    Learner,
    choice_from_dict,
)


@dataclass(frozen=True)
class RunFolder:
    """Files of one run in the folder ``path``."""

    path: Path

    @property
    def settings(self) -> Path:
        """Settings of the run: JSON, written once."""
        return self.path / "run.json"

    @property
    def checkpoint(self) -> Path:
        """The learner as it was at the last evaluation."""
        return self.path / "checkpoint.pt"

    @property
    def replay(self) -> Path:
        """Replay buffer of SAC and TD3, which would have to be filled again without it."""
        return self.path / "replay.pt"

    @property
    def policy(self) -> Path:
        """Description of the best policy so far."""
        return self.path / "policy.json"

    def begin(self, choice: Choice, model: Model, command: str) -> None:
        """Write the settings of a new run.

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
            If there is none, or its settings cannot be read: file, path in it and cause.
        """
        if not self.settings.exists():
            raise InputError(f"{self.path}: holds no run to resume (no run.json)")
        return read_json(self.settings, RUN_FILE)

    def save(self, state: Mapping[str, Any], replay: Mapping[str, Any] | None) -> None:
        """Write a checkpoint; no partly written file is left.

        The replay comes first: after an interruption in between, the older checkpoint has a newer
        replay, which does no harm.
        """
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
        # On the CPU: a checkpoint from a GPU must be readable on a machine without one.
        found = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: no checkpoint of a run: {reason[:120]}") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: no checkpoint of a run")
    return found


def _run(content: dict[str, Any], source: str) -> tuple[Choice, Model, str]:
    model = model_from_dict(content["model"], f"{source}: model")
    return choice_from_dict(content["choice"]), model, str(content["command"])


def _fields_of(kind: type, required: list[str], **known: Schema) -> Schema:
    """JSON schema of a dataclass: its fields and no others, with schemas for some of them."""
    names: dict[str, Schema] = {field.name: {} for field in fields(kind)}
    return {
        "type": "object",
        "properties": names | known,
        "required": required,
        "additionalProperties": False,
    }


COUNT: Schema = {"type": "integer", "minimum": 1}
STEPS: Schema = {**COUNT, "maximum": MOST_STEPS}
ENVS: Schema = {**COUNT, "maximum": MOST_ENVS}
TABLE: Schema = {"type": "object"}

RUN_FILE = FileKind(
    "a run of `youbot train`",
    {
        "type": "object",
        "properties": {
            "choice": _fields_of(
                Choice,
                # Fields with a default may be missing: earlier versions had fewer fields.
                ["algorithm", "learner", "conditions", "effects"],
                algorithm={"type": "string"},
                learner=_fields_of(
                    Learner,
                    ["steps", "envs", "learning", "policy"],
                    steps=STEPS,
                    envs=ENVS,
                    evaluations=COUNT,
                    learning=TABLE,
                    policy=TABLE,
                    conditions=TABLE,
                    final_learning_rate={"type": "number", "minimum": 0},
                    activation={"type": "string"},
                    features={"type": "string"},
                    mixed={"type": "boolean"},
                ),
                conditions=_fields_of(Conditions, []),
                effects={"type": "array", "items": {"type": "string"}},
                base={"type": ["string", "null"]},
                share={"type": "number"},
                seed={"type": "integer"},
            ),
            "model": TABLE,
            "command": {},
        },
        "required": ["choice", "model", "command"],
    },
    _run,
    version=None,
)
