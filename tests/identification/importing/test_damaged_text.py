"""Text that is damaged anywhere is read or refused in one line: no traceback, no warning."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from identification.importing.importing import import_source, open_source, runs_of_source
from tests.identification.importing.layouts import LAYOUTS
from youbot_env.errors import InputError

PIECES = (b",", b";", b"\n", b'"', b"nan", b"[", b"\x00", b"1e309", b"\xff", b"time", b"9" * 19)
SEEDS = {name: b"\n".join(write().encode().split(b"\n")[:70]) for name, write in LAYOUTS.items()}


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """The content with some of its bytes changed, lost, doubled, or put in between."""
    found = bytearray(content)
    for _ in range(rng.integers(1, 10)):
        at, kind = int(rng.integers(0, len(found) + 1)), rng.random()
        if kind < 0.4:
            found[at:at] = PIECES[rng.integers(len(PIECES))]
        elif kind < 0.6:
            del found[at : at + int(rng.integers(1, 60))]
        elif kind < 0.8:
            found[at : at + 1] = bytes([rng.integers(0, 256)])
        else:
            start = int(rng.integers(0, len(found) + 1))
            found[at:at] = found[start : start + int(rng.integers(1, 200))]
    return bytes(found)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_text(seed: int, tmp_path: Path) -> None:
    rng, path = np.random.default_rng(seed), tmp_path / "damaged.csv"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for content in SEEDS.values():
            path.write_bytes(damaged(content, rng))
            read_or_refused(path)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_cut_text(layout: str, tmp_path: Path) -> None:
    content, path = SEEDS[layout], tmp_path / "cut.csv"
    for share in (0.003, 0.03, 0.3, 0.6, 0.99):
        path.write_bytes(content[: int(share * len(content))])
        read_or_refused(path)


def read_or_refused(path: Path) -> None:
    try:
        source = open_source([path])
        import_source(source)
        runs_of_source(source)
        assert source.map_text
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("damage", ["0,5", "3.4x2", "wheel_joint_fl", "[1, 2]", "1e999"])
def test_a_value_of_an_echoed_message_that_is_no_number_is_missing(
    damage: str, tmp_path: Path
) -> None:
    path, text = tmp_path / "echo.csv", LAYOUTS["echoed_yaml"]()
    head, tail = text.split("velocity:\n- ", 1)
    path.write_text(f"{head}velocity:\n- {damage}\n{tail.partition(chr(10))[2]}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_or_refused(path)


@pytest.mark.parametrize("far", ["1e308", "-1e308"])
def test_numbers_as_far_apart_as_they_can_be(far: str, tmp_path: Path) -> None:
    path, text = tmp_path / "far.csv", LAYOUTS["plain"]()
    rows = text.splitlines()
    rows[3] = ",".join([rows[3].split(",")[0], far, *rows[3].split(",")[2:]])
    rows[4] = ",".join([rows[4].split(",")[0], f"{-float(far)!r}", *rows[4].split(",")[2:]])
    path.write_text("\n".join(rows))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_or_refused(path)


HUGE = "9" * 400

MESSAGE = {
    "header": "{stamp: {sec: 170000000%d, nanosec: 10}, frame_id: ''}",
    "name": "[wheel_joint_fl, wheel_joint_fr, wheel_joint_bl, wheel_joint_br]",
    "velocity": "[1.0, 2.0, 3.0, 4.0]",
    "effort": "[1.0, 2.0, 3.0, 4.0]",
}


@pytest.mark.parametrize(
    "wrong",
    [
        {"velocity": "7"},
        {"effort": f"[{HUGE}, 2.0, 3.0, 4.0]"},
        {"header": f"{{stamp: {{sec: {HUGE}, nanosec: {HUGE}}}}}"},
        {"header": f"{{stamp: {HUGE}}}"},
        {"name": "7", "joint_names": "7", "interface_values": "7"},
        {"joint_names": "[fl, fr]", "interface_values": "[7, {interface_names: 1, values: 2}]"},
        {"joint_names": "[fl, fr]", "output": "{positions: 7, velocities: [[], {}]}"},
        {"odd": f"{{a: {HUGE}, b: [{HUGE}, true]}}"},
    ],
)
def test_messages_whose_fields_hold_something_else(wrong: dict[str, str], tmp_path: Path) -> None:
    texts = []
    for k in range(6):
        fields = MESSAGE | (wrong if k == 3 else {})
        texts.append("\n".join(f"{key}: {value}" for key, value in fields.items()))
    path = tmp_path / "echo.yaml"
    path.write_text("\n---\n".join(text.replace("%d", str(k)) for k, text in enumerate(texts)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_or_refused(path)
