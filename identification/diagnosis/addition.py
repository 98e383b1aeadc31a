"""The result of adding one effect to a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from identification.diagnosis.report import estimates
from identification.diagnosis.settings import DiagnosisSettings
from identification.diagnosis.structures import Step
from identification.mechanisms.samples import Samples
from identification.showing import Shown


@dataclass(frozen=True, repr=False)
class Addition(Shown):
    """Result of :func:`add_effect`.

    Attributes
    ----------
    before, after : held-out errors of the refitted model without and with the effect
    noise_floor : what measurement noise alone would leave, with the effect
    p_value : of the effect, by wild block bootstrap
    worthwhile : whether the fall is material and significant and the size plausible
    reasons : why it is not worthwhile, in words
    samples : the logs
    settings : all numbers that this depends on
    """

    effect: str
    model: Any
    before: Step
    after: Step
    noise_floor: dict[str, float]
    p_value: float
    worthwhile: bool
    reasons: tuple[str, ...]
    sentence: str
    samples: tuple[Samples, ...] = ()
    settings: DiagnosisSettings = field(default_factory=DiagnosisSettings)
    kind: ClassVar[str] = "addition"

    def summary(self) -> str:
        """How far the error falls, and whether that is worth an effect."""
        worth = "worth it" if self.worthwhile else f"not worth it: {'; '.join(self.reasons)}"
        return (
            f"with {self.effect} the force error goes from {self.before.force_error:.2%} to "
            f"{self.after.force_error:.2%} (noise {self.noise_floor['force_error']:.2%}), {worth}"
        )

    def rows(self) -> list[dict[str, Any]]:
        """Held-out errors before and after."""
        return [
            {"with": name, "force error": step.force_error, "velocity error": step.velocity_error}
            for name, step in (("before", self.before), (self.effect, self.after))
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.effect,
            "before": self.before.errors,
            "after": self.after.errors,
            "noise_floor": self.noise_floor,
            "p_value": self.p_value,
            "worthwhile": self.worthwhile,
            "reasons": list(self.reasons),
            "words": self.sentence,
            "parameters": estimates(self.model.effects[self.effect]),
            "settings": self.settings.to_dict(),
        }
