"""One reader under atheris: ``python -m tests.fuzz.guided READER FAILURES SECONDS``."""

from __future__ import annotations

import random
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any


def run(name: str, failures: Path, seconds: float) -> None:
    """Let atheris mutate the reader's good files; it ends the process."""
    # It has no types.
    atheris: Any = import_module("atheris")

    with atheris.instrument_imports(include=["youbot_env", "identification", "controllers"]):
        from tests.fuzz.__main__ import seeds
        from tests.fuzz.readers import readers
    from tests.fuzz.mutations import mutated
    from tests.fuzz.trying import fault

    folder = Path(tempfile.mkdtemp())
    reader = readers()[name]
    good = seeds(reader, folder / "seeds")
    contents = [path.read_bytes() for path in good]
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, content in enumerate(contents):
        # The first byte says which file it is: readers go by a file's ending.
        (corpus / str(number)).write_bytes(bytes([number]) + content)

    def one(data: bytes) -> None:
        path = good[data[0] % len(good)] if data else good[0]
        path.write_bytes(data[1:])
        found = fault(reader.read, path)
        if found is not None:
            raise AssertionError(found)

    def ours(data: bytes, most: int, seed: int) -> bytes:
        draw = random.Random(seed)
        if draw.random() < 0.5 or not data:
            return atheris.Mutate(data, most)
        return (data[:1] + mutated(draw, data[1:], draw.choice(contents)))[:most]

    longest = max(map(len, contents)) * 2
    options = [f"-max_total_time={max(1, round(seconds))}", f"-max_len={longest}", "-timeout=20"]
    options += [f"-artifact_prefix={failures}/", "-rss_limit_mb=4096", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=ours)
    atheris.Fuzz()


if __name__ == "__main__":
    run(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]))
