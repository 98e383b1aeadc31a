"""What a tool claims of a blind set: its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from youbot_env.files import SCHEMA_VERSION, FileKind, Schema, read_json, write_json

VERDICTS = ("adequate", "effect", "ambiguous", "unknown")


@dataclass(frozen=True)
class Claim:
    """What a tool says of one case: see the rules in `published`."""

    verdict: str
    effects: tuple[tuple[str, ...], ...] = ()
    law: Mapping[str, Any] | None = None
    predictions: str | None = None
    seconds: float | None = None

    def found(self) -> dict[str, Any]:
        """The claim with the keys of a diagnosis, as scores read them."""
        law = None if self.law is None else {"variables": [], "name": "", **self.law}
        return {
            "verdict": self.verdict,
            "missing": [names[0] for names in self.effects],
            "ambiguous_with": {n[0]: list(n[1:]) for n in self.effects if len(n) > 1},
            "proposal": law,
        }


Claims = dict[str, Claim]
"""By a case's code."""

CLAIM: Schema = {
    "type": "object",
    "properties": {
        "verdict": {"enum": list(VERDICTS)},
        "effects": {
            "type": "array",
            "items": {"type": "array", "items": {"type": "string"}, "minItems": 1},
        },
        "law": {
            "type": ["object", "null"],
            "properties": {
                "site": {"type": "string"},
                "variables": {"type": "array", "items": {"type": "string"}},
            },
            "required": ["site", "variables"],
        },
        "predictions": {"type": ["string", "null"]},
        "seconds": {"type": ["number", "null"]},
    },
    "required": ["verdict"],
}


def _claim(entry: Mapping[str, Any]) -> Claim:
    effects = tuple(tuple(names) for names in entry.get("effects", ()))
    rest = (entry.get(key) for key in ("law", "predictions", "seconds"))
    return Claim(entry["verdict"], effects, *rest)


CLAIMS_FILE = FileKind(
    "a tool's answers",
    {
        "type": "object",
        "properties": {
            "tool": {"type": "string"},
            "cases": {"type": "object", "additionalProperties": CLAIM},
        },
        "required": ["tool", "cases"],
    },
    lambda content, source: {code: _claim(entry) for code, entry in content["cases"].items()},
)


def write_claims(path: Path, tool: str, claims: Mapping[str, Claim]) -> None:
    """Write a tool's answers."""
    cases = {code: asdict(claim) for code, claim in sorted(claims.items())}
    write_json(path, {"schema_version": SCHEMA_VERSION, "tool": tool, "cases": cases})


def read_claims(path: Path) -> Claims:
    """Read a tool's answers.

    Raises
    ------
    InputError
        If it is no such file.
    """
    return read_json(path, CLAIMS_FILE)
