"""Numbers of options that no machine could serve are one line at once, not hours or gigabytes."""

from __future__ import annotations

import time

import pytest

from tests.fuzz.readers import has
from youbot_scripts.cli import main

COMMANDS = [
    "evaluate --model paper --rate 1e9",
    "evaluate --model paper --rate 1e308",
    "evaluate --model paper --rate 1e-9",
    "evaluate --model paper --delay 1000000000",
    "evaluate --model paper --delay 999999999999999999999999",
    "evaluate --model paper --duration 1e12",
    "evaluate --model paper --duration 1e308",
    "evaluate --model paper --seeds 1000000000",
    "evaluate --model paper --jobs 1000000000",
    "tune paper --delay 1e9",
    "tune paper --rate 1e9",
    "tune paper --runs 1000000000000",
    "tune paper --duration 1e308",
    "bench --cases 1000000000",
    "bench --jobs 1000000000",
    "record OUT --rate 1e9",
    "record OUT --rate 1e308",
    "export paper --to c -o OUT --rate 1e9",
    "export paper --to c -o OUT --delay 1e9",
]
LEARNING = [
    "train ppo --output OUT --envs 1000000000",
    "train ppo --output OUT --steps 1000000000000000000000",
]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS + (LEARNING if has("torch") else []))
def test_huge_numbers_are_one_line(command: str, tmp_path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "out"
    start = time.perf_counter()
    assert main([str(out) if word == "OUT" else word for word in command.split()]) == 2
    assert time.perf_counter() - start < 30.0
    told = capsys.readouterr()
    assert len(told.err.splitlines()) == 1 and not told.out and not out.exists()
