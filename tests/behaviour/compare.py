"""Compare two records of behaviour: prints each path that differs, exits 1 if there is one.

    python -m tests.behaviour.compare BEFORE AFTER [--relative 1e-9]

Without --relative, or with 0, everything must agree to the bit. With it, numbers a and b agree if
|a - b| <= relative * max(|a|, |b|, largest absolute value in the list that they stand in): an entry
that is nearly zero beside the others of its vector is rounding. Words must agree exactly all the
same; numbers inside of texts, the wrapping of lines, and hashes are then left aside, since rounding
changes them. Only cases that both records hold are compared; the others are named.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MOST = 40
"""Differences that are printed of a case."""

WIDEST = 110
"""Letters of a value that are printed."""

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?(?![\w.]*\w)", re.IGNORECASE)
HASH = re.compile(r"\b[0-9a-f]{64}\b")
RULE = re.compile(r"[─━]+")

Difference = tuple[str, str, str]
"""Path, before, after."""


def differences(
    before: Any, after: Any, relative: float = 0.0, path: str = "", scale: float = 0.0
) -> Iterator[Difference]:
    """Where two values of JSON differ.

    Parameters
    ----------
    relative : tolerance of numbers
    path : of the values in their record
    scale : largest absolute value beside these, in a list of numbers
    """
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            where = f"{path}/{key}"
            if key not in after:
                yield where, _short(before[key]), "nothing"
            elif key not in before:
                yield where, "nothing", _short(after[key])
            else:
                yield from differences(before[key], after[key], relative, where)
    elif isinstance(before, list) and isinstance(after, list):
        yield from _of_lists(before, after, relative, path)
    elif not _alike(before, after, relative, scale):
        yield path, _short(before), _short(after)


def _of_lists(before: list, after: list, relative: float, path: str) -> Iterator[Difference]:
    if relative > 0 and _is_text(before) and _is_text(after):
        yield from _of_texts(before, after, path)
        return
    if len(before) != len(after):
        yield path, f"{len(before)} items", f"{len(after)} items"
    scale = max(
        (abs(x) for x in [*before, *after] if _is_number(x) and math.isfinite(x)), default=0
    )
    for k, (one, other) in enumerate(zip(before, after, strict=False)):
        yield from differences(one, other, relative, f"{path}[{k}]", scale)


def _of_texts(before: list[str], after: list[str], path: str) -> Iterator[Difference]:
    """The first words that differ: what follows them is often the same, moved on."""
    one, other = (masked(" ".join(lines)).split() for lines in (before, after))
    if one != other:
        pairs = enumerate(zip(one, other, strict=False))
        k = next((k for k, (a, b) in pairs if a != b), min(len(one), len(other)))
        some = slice(max(0, k - 4), k + 8)
        yield (
            f"{path} from word {k + 1}",
            _short(" ".join(one[some])),
            _short(" ".join(other[some])),
        )


def masked(text: str) -> str:
    """A text's words, without what rounding may change: numbers, hashes, the width of tables."""
    return " ".join(NUMBER.sub("#", RULE.sub("─", HASH.sub("<hash>", text))).split())


def _alike(before: Any, after: Any, relative: float, scale: float) -> bool:
    if _is_number(before) and _is_number(after):
        if before == after or (math.isnan(before) and math.isnan(after)):
            return True
        if not (math.isfinite(before) and math.isfinite(after)):
            return False
        return abs(before - after) <= relative * max(abs(before), abs(after), scale)
    if isinstance(before, str) and isinstance(after, str) and relative > 0:
        return masked(before) == masked(after)
    return type(before) is type(after) and before == after


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_text(lines: list) -> bool:
    return all(isinstance(line, str) for line in lines)


def _short(value: Any) -> str:
    text = repr(value) if _is_number(value) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= WIDEST else f"{text[:WIDEST]}..."


def cases(folder: Path) -> dict[str, Path]:
    """Files of a record by the name of their case."""
    return {p.stem: p for p in sorted(folder.glob("*.json")) if not p.name.startswith("_")}


def main(arguments: list[str] | None = None) -> int:
    """Command line: see the module's docstring. The exit status is 0, 1, or 2 for no records."""
    parser = argparse.ArgumentParser(description="Compare two records of behaviour.")
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--relative", type=float, default=0.0, help="tolerance (default: 0, exact)")
    given = parser.parse_args(arguments)
    before, after = cases(given.before), cases(given.after)
    common = [name for name in before if name in after]
    if not common:
        print(f"compare: {given.before} and {given.after} have no case in common", file=sys.stderr)
        return 2
    for names, where in (
        (before.keys() - after, given.before),
        (after.keys() - before, given.after),
    ):
        if names:
            print(f"only in {where}: {', '.join(sorted(names))}")
    changed = 0
    for name in common:
        one, other = (json.loads(p.read_text("utf-8")) for p in (before[name], after[name]))
        found = list(differences(one, other, given.relative))
        changed += bool(found)
        _show(name, found)
    print(f"{len(common)} cases compared, {changed} differ")
    return int(changed > 0)


def _show(name: str, found: list[Difference]) -> None:
    for path, before, after in found[:MOST]:
        print(f"{name}{path}\n    before {before}\n    after  {after}")
    if len(found) > MOST:
        print(f"{name}: {len(found) - MOST} more")


if __name__ == "__main__":
    sys.exit(main())
