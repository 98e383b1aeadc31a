"""Try mutated files on every reader, for a time or a number of them.

    python -m tests.fuzz --seconds 60                  all readers, one after the other
    python -m tests.fuzz --count 1000000 --seed 7      so many files in all
    python -m tests.fuzz --reader log --seconds 600 --guided

A file that is read wrongly is kept in --failures with what was wrong. The same seed makes the same
files. ``--guided`` lets atheris, where it is installed, choose mutations by the code that they
reach. Exit status 1 if anything was wrong.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from tests.fuzz.mutations import mutated
from tests.fuzz.readers import Reader, has, readers
from tests.fuzz.trying import fault

MOST_KEPT = 20
"""Files of one reader that are kept: the first ones tell what is wrong."""


def seeds(reader: Reader, folder: Path) -> list[Path]:
    """The good files of a reader, each in a folder of its own."""
    found: list[Path] = []
    for number, make in enumerate(reader.seeds):
        (folder / str(number)).mkdir(parents=True, exist_ok=True)
        found.append(make(folder / str(number)))
    return found


def corpus(folder: Path) -> dict[str, list[Path]]:
    """The good files of all readers."""
    return {
        name: seeds(reader, folder / name.replace(" ", "_")) for name, reader in readers().items()
    }


def files(draw: random.Random, good: list[Path]) -> Iterator[Path]:
    """Paths of mutated files without end; each stands where the good one stood."""
    contents = [path.read_bytes() for path in good]
    for _ in count():
        number = draw.randrange(len(good))
        content = mutated(draw, contents[number], draw.choice(contents))
        good[number].write_bytes(content)
        yield good[number]


def try_out(
    name: str, seconds: float, most: int, seed: int, failures: Path, folder: Path
) -> tuple[int, list[str]]:
    """How many files were tried on a reader, and what was wrong with some of them."""
    reader, wrong = readers()[name], []
    draw = random.Random(f"{name} {seed}")
    good = seeds(reader, folder / name.replace(" ", "_"))
    end, tried = time.monotonic() + seconds, 0
    for path in good:
        if (found := fault(reader.read, path)) is not None:
            raise AssertionError(f"{name}: a good file is not read: {found}")
    for path in files(draw, good):
        if tried >= most or time.monotonic() > end or len(wrong) >= MOST_KEPT:
            break
        tried += 1
        if (found := fault(reader.read, path)) is not None:
            wrong.append(found)
            keep = failures / f"{name.replace(' ', '_')}-{seed}-{tried}"
            keep.mkdir(parents=True, exist_ok=True)
            (keep / path.name).write_bytes(path.read_bytes())
            (keep / "fault.txt").write_text(found, "utf-8", "backslashreplace")
    return tried, wrong


def main(arguments: list[str] | None = None) -> int:
    """Run; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Try mutated files on every reader.")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--count", type=int, default=sys.maxsize)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", action="append", choices=list(readers()))
    parser.add_argument("--failures", type=Path, default=Path("fuzz_failures"))
    parser.add_argument("--guided", action="store_true")
    asked = parser.parse_args(arguments)
    names = asked.reader or list(readers())
    if asked.guided:
        return guided(names, asked.seconds / len(names), asked.failures)
    # In a time budget each reader has its part; in a number of files, too.
    seconds = asked.seconds / len(names) if asked.count == sys.maxsize else float("inf")
    status = 0
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            most = asked.count if asked.count == sys.maxsize else -(-asked.count // len(names))
            tried, wrong = try_out(name, seconds, most, asked.seed, asked.failures, Path(folder))
        print(f"{name}: {tried} files, {len(wrong)} read wrongly", flush=True)
        for text in wrong[:3]:
            print("   ", text.strip().splitlines()[-1][:160])
        status |= bool(wrong)
    return status


def guided(names: list[str], seconds: float, failures: Path) -> int:
    """The same by atheris, a process for each reader."""
    if not has("atheris"):
        print("atheris is not installed (pip install atheris): mutations without its guidance")
        return main(["--seconds", str(seconds * len(names)), *(f"--reader={n}" for n in names)])
    status = 0
    for name in names:
        kept = failures / f"guided-{name.replace(' ', '_')}"
        kept.mkdir(parents=True, exist_ok=True)
        command = [
            sys.executable,
            "-m",
            "tests.fuzz.guided",
            name,
            str(kept.absolute()),
            str(seconds),
        ]
        done = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ))
        runs = [line for line in done.stderr.splitlines() if line.startswith("Done ")]
        print(f"{name}: {runs[-1] if runs else 'ended early'}", flush=True)
        if done.returncode:
            print(done.stderr[-1500:])
        status |= bool(done.returncode)
    return status


if __name__ == "__main__":
    sys.exit(main())
