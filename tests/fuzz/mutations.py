"""Mutations of a file's bytes: blind ones, and ones that know lines, cells and JSON."""

from __future__ import annotations

import gzip
import json
import random
from collections.abc import Callable
from typing import Any

ODD: tuple[Any, ...] = (
    *(0, -1, 1, 2, 10**400, -(10**19), 1e308, -1e308, 1e-320, 0.1, float("nan"), float("inf")),
    *(
        "",
        "x",
        "nan",
        "1e999",
        "\x00",
        "\x1b[31m",
        "\ud800",
        "\u202e",
        "../../etc/passwd",
        "a" * 9999,
    ),
    *(None, True, False, [], {}, [[]], [{}], {"": ""}, [None], {"value": {}}, [1e308] * 3),
)
"""Values that a reader may not expect."""

CELLS = (
    *("", " ", "nan", "-inf", "1e308", "-1e308", "1e-320", "1e999", "0", "-0", "1_000", "0x1p3"),
    *("1,5", "1;5", '"', '""', "'", "#", "\t", "true", "None", "[1, 2]", "{", "1.7e18", "-1.7e18"),
    *(
        "9" * 400,
        "a" * 5000,
        "\u0661\u0662",
        "\ufeff",
        "\x1b[2J",
        "\u2028",
        "12:30:00",
        "2024-02-30",
    ),
)
"""Contents of a cell that a reader may not expect."""

TOKENS = (
    *(
        b"\x00",
        b"\xff",
        b"\n",
        b"\r",
        b",",
        b'"',
        b"\x1f\x8b",
        b"PAR1",
        b"\xef\xbb\xbf",
        b"\xff\xfe",
    ),
    *(
        b"\x7f\xff\xff\xff",
        b"\xff" * 8,
        b"\x00" * 8,
        b"\x80\x00\x00\x00\x00\x00\x00\x00",
        b"PK\x03\x04",
    ),
    *(
        b"{",
        b"[",
        b"}",
        b"]",
        b":",
        b"NaN",
        b"1e400",
        b"\\u0000",
        b"#ROSBAG V2.0\n",
        b"\x89MCAP0\r\n",
    ),
)

Mutate = Callable[[random.Random, bytes], bytes]


def mutated(draw: random.Random, content: bytes, other: bytes) -> bytes:
    """A file's content after some mutations; ``other`` is the content of another file."""
    if content.startswith(b"\x1f\x8b") and draw.random() < 0.8:
        try:
            return gzip.compress(mutated(draw, gzip.decompress(content), other), 1)
        except (OSError, EOFError):
            pass
    if draw.random() < 0.02:
        cut = draw.randrange(len(content) + 1)
        return content[:cut] + other[draw.randrange(len(other) + 1) :]
    is_json = content[:1] in (b"{", b"[")
    kinds = (*BLIND, *TEXT, *([of_json] * 12 if is_json else []))
    for _ in range(draw.choice((1, 1, 1, 2, 3, 8))):
        content = draw.choice(kinds)(draw, content)
    return content


# --- blind -----------------------------------------------------------------------------------


def flip(draw: random.Random, content: bytes) -> bytes:
    """Change one bit."""
    if not content:
        return content
    place = draw.randrange(len(content))
    changed = bytes([content[place] ^ (1 << draw.randrange(8))])
    return content[:place] + changed + content[place + 1 :]


def overwrite(draw: random.Random, content: bytes) -> bytes:
    """Replace some bytes by random ones or by a token."""
    place = draw.randrange(len(content) + 1)
    new = draw.choice((draw.choice(TOKENS), draw.randbytes(draw.randrange(1, 9))))
    return content[:place] + new + content[place + len(new) :]


def insert(draw: random.Random, content: bytes) -> bytes:
    """Put a token in."""
    place = draw.randrange(len(content) + 1)
    return content[:place] + draw.choice(TOKENS) * draw.choice((1, 1, 2, 1000)) + content[place:]


def remove(draw: random.Random, content: bytes) -> bytes:
    """Leave a part out."""
    place = draw.randrange(len(content) + 1)
    return content[:place] + content[place + draw.choice((1, 2, 8, 100, 10_000)) :]


def repeat(draw: random.Random, content: bytes) -> bytes:
    """Say a part twice."""
    place = draw.randrange(len(content) + 1)
    part = content[place : place + draw.choice((1, 8, 100, 5000))]
    return content[:place] + part + content[place:]


def cut(draw: random.Random, content: bytes) -> bytes:
    """End early."""
    return content[: draw.randrange(len(content) + 1)]


BLIND: tuple[Mutate, ...] = (flip, flip, overwrite, insert, remove, repeat, cut)


# --- lines and cells -------------------------------------------------------------------------


def cell(draw: random.Random, content: bytes) -> bytes:
    """Replace one cell of a table."""
    lines = content.split(b"\n")
    # The header is one line of many, and the one that matters.
    row = 0 if draw.random() < 0.2 else draw.randrange(len(lines))
    cells = lines[row].split(b",")
    cells[draw.randrange(len(cells))] = draw.choice(CELLS).encode("utf-8", "surrogatepass")
    lines[row] = b",".join(cells)
    return b"\n".join(lines)


def column(draw: random.Random, content: bytes) -> bytes:
    """Replace a whole column of a table by a value, a constant, or another column."""
    rows = [line.split(b",") for line in content.split(b"\n")]
    place, source = draw.randrange(len(rows[0])), draw.randrange(len(rows[0]))
    value = draw.choice((None, *CELLS))
    for row in rows[draw.choice((0, 1, 1, 1)) :]:
        if max(place, source) < len(row):
            row[place] = row[source] if value is None else value.encode("utf-8", "surrogatepass")
    return b"\n".join(b",".join(row) for row in rows)


def lines(draw: random.Random, content: bytes) -> bytes:
    """Swap, repeat, remove or keep some lines."""
    rows = content.split(b"\n")
    a, b = draw.randrange(len(rows)), draw.randrange(len(rows))
    action = draw.randrange(5)
    if action == 0:
        rows[a], rows[b] = rows[b], rows[a]
    elif action == 1:
        rows.insert(b, rows[a])
    elif action == 2:
        del rows[min(a, b) : max(a, b)]
    elif action == 3:
        rows = rows[: draw.choice((1, 2, 3, 51))]
    else:
        rows = [*rows, *rows[draw.choice((0, 1)) :]]
    return b"\n".join(rows)


def delimiter(draw: random.Random, content: bytes) -> bytes:
    """Separate cells, or end lines, otherwise."""
    old, new = draw.choice(
        ((b",", b";"), (b",", b"\t"), (b"\n", b"\r\n"), (b"\n", b"\r"), (b".", b","))
    )
    return content.replace(old, new)


TEXT: tuple[Mutate, ...] = (cell, cell, cell, column, column, lines, lines, delimiter)


# --- JSON ------------------------------------------------------------------------------------


def of_json(draw: random.Random, content: bytes) -> bytes:
    """Change a node of a JSON text; bytes that are no JSON are changed blindly."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError):
        return draw.choice(BLIND)(draw, content)
    nodes = list(_nodes(tree))
    if not nodes:
        return content
    # A shallow node is rarer than a deep one, and says more.
    holder, key = min(draw.sample(nodes, min(len(nodes), draw.choice((1, 3)))), key=lambda n: n[2])[
        :2
    ]
    action = draw.randrange(6)
    if action == 0:
        del holder[key]
    elif action == 1 and isinstance(holder, dict):
        holder[draw.choice(("", "stranger", "\x1b[31m", "\ud800", "__class__", "k" * 5000))] = (
            holder[key]
        )
    elif action == 2 and isinstance(holder[key], (int, float)) and holder[key] not in (True, False):
        holder[key] = holder[key] * draw.choice((-1, 0, 1e-12, 1e12, 1e200, 1.5))
    elif action == 3:
        other, place = draw.choice(nodes)[:2]
        # Through JSON: a node that holds itself could not be written.
        holder[key] = json.loads(json.dumps(other[place] if place in _keys(other) else None))
    else:
        holder[key] = draw.choice(ODD)
    text = json.dumps(tree)
    if draw.random() < 0.05 and text.startswith("{") and isinstance(tree, dict) and tree:
        twice = draw.choice(list(tree))
        text = "{" + json.dumps(twice) + ": 1, " + text[1:]
    return text.encode("utf-8", "surrogatepass")


def _keys(holder: Any) -> Any:
    return holder if isinstance(holder, dict) else range(len(holder))


def _nodes(tree: Any, depth: int = 0) -> Any:
    for key in _keys(tree) if isinstance(tree, (dict, list)) else ():
        yield tree, key, depth
        yield from _nodes(tree[key], depth + 1)
