"""What the controllers are built on: a model that is known, given, identified or diagnosed."""

from __future__ import annotations

import difflib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from identification.logs.log import Log
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict
from youbot_env.physics.effect import CATALOGUE
from youbot_scripts.evaluation.plants import LAG, PlantSource
from youbot_scripts.recording.named_motions import motions_named

KNOWN, IDENTIFIED, DIAGNOSED = "known", "identified", "diagnosed"

WORDS = (KNOWN, IDENTIFIED, DIAGNOSED)
"""What may stand for a model beside a file's name."""

MOTIONS = "calibration,multisine_a"
"""Driven to identify a plant: the paper's motions and a multisine to hold out."""


@dataclass(frozen=True)
class ModelSource:
    """How a model of a plant comes about.

    Attributes
    ----------
    how : "known" (the plant's own, true to the last digit), "identified" (the base model fitted to
        noisy logs of the plant, "identified+NAME" with an effect), "diagnosed" (the same, and
        whatever ``diagnose`` finds missing), or a model file. Drives that are known to lag belong
        to the base model.

    Raises
    ------
    InputError
        If it names no such thing.
    """

    how: str = IDENTIFIED

    def __post_init__(self) -> None:
        word, *effects = self.how.split("+")
        if word == IDENTIFIED:
            for effect in effects:
                CATALOGUE[effect]
        elif self.how not in (KNOWN, DIAGNOSED) and not Path(self.how).exists():
            self._check_file()

    def _check_file(self) -> None:
        try:
            load_model(self.how)
        except InputError as error:
            close = difflib.get_close_matches(self.how, WORDS, 1)
            hint = f"; did you mean {close[0]!r}?" if close else f", nor {', '.join(WORDS)}"
            raise InputError(f"{error}{hint}") from None

    @property
    def learns(self) -> bool:
        """Whether logs of the plant have to be made."""
        return self.how.split("+")[0] in (IDENTIFIED, DIAGNOSED)

    def of(self, plant: PlantSource, seed: int = 0) -> Model:
        """The model of a plant, as it reads from a file.

        Raises
        ------
        InputError
            If the file cannot be read, or the logs do not show what has to be fitted.
        """
        if self.how == KNOWN:
            return plant.truth
        if not self.learns:
            return load_model(self.how)
        motions = motions_named(MOTIONS, plant.truth.geometry, seed)
        found = self._fitted(plant, plant.logs(motions, seed), seed)
        # An interrupted run reads it from a file: the same digits here, so the same results.
        return model_from_dict(json.loads(json.dumps(model_to_dict(found))), self.how)

    def _fitted(self, plant: PlantSource, logs: Sequence[Log], seed: int) -> Model:
        start = replace(load_model("paper"), geometry=plant.truth.geometry)
        if plant.lag:
            start = start.with_effect(LAG)
        if self.how == DIAGNOSED:
            from identification.diagnosis.diagnose import diagnose

            return diagnose(start, logs, seed=seed).model
        from identification.fitting.identify import identify

        for effect in self.how.split("+")[1:]:
            start = start.with_effect(effect)
        return identify(logs, start=start, recursive=False, seed=seed).model

    def __str__(self) -> str:
        return self.how
