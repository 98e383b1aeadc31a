"""Mutated files are read, or refused in one line: a few each time, a minute in the slow tests."""

from __future__ import annotations

import random
import resource
import warnings
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from tests.fuzz import trying
from tests.fuzz.__main__ import corpus, main, seeds, try_out
from tests.fuzz.mutations import BLIND, TEXT, mutated, of_json
from tests.fuzz.readers import has, readers
from youbot_env.errors import InputError
from youbot_env.files import FileKind

NAMES = tuple(readers())
COSTLY = ("bag", "table")
"""Readers that take a tenth of a second and more for a file."""


def test_every_kind_of_file_has_seeds_that_are_read(tmp_path: Path):
    for name, paths in corpus(tmp_path).items():
        assert paths and all(path.is_file() for path in paths), name


@pytest.mark.parametrize("name", NAMES)
def test_some_mutations_are_read_or_refused(name: str, tmp_path: Path):
    count = 3 if name in COSTLY else 30
    tried, wrong = try_out(name, float("inf"), count, 3, tmp_path / "failures", tmp_path)
    assert tried == count and not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_a_minute_of_mutations(tmp_path: Path):
    assert main(["--seconds", "60", "--seed", "11", "--failures", str(tmp_path)]) == 0


@pytest.mark.slow
def test_a_short_run_that_atheris_guides(tmp_path: Path):
    if not has("atheris"):
        pytest.skip("atheris is not installed: its guidance is not tried")
    arguments = ["--guided", "--seconds", "20", "--failures", str(tmp_path)]
    assert main([*arguments, "--reader", "geometry", "--reader", "log"]) == 0


@given(st.binary(max_size=300))
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("run", "bag")])
def test_any_bytes_are_read_or_refused(
    name: str, tmp_path_factory: pytest.TempPathFactory, content: bytes
):
    reader = readers()[name]
    folder = tmp_path_factory.mktemp("any")
    (path,) = seeds(trying_first(reader), folder)
    path.write_bytes(content)
    assert trying.fault(reader.read, path) is None


def trying_first(reader):
    return type(reader)(reader.seeds[:1], reader.read)


@pytest.mark.slow
@pytest.mark.skipif(not has("rosbags", "mcap"), reason="needs the extra for bags")
@pytest.mark.parametrize("number", range(len(readers()["bag"].seeds) if "bag" in NAMES else 0))
def test_a_bag_that_is_cut_anywhere_is_read_or_refused(number: int, tmp_path: Path):
    reader = readers()["bag"]
    path = reader.seeds[number](tmp_path)
    whole = path.read_bytes()
    # Every byte of the first and last 200, and as many between them.
    ends = {*range(200), *range(len(whole) - 200, len(whole))}
    for size in sorted(ends | set(range(0, len(whole), max(1, len(whole) // 200)))):
        path.write_bytes(whole[:size])
        assert trying.fault(reader.read, path) is None, size


# --- the fuzzer itself -----------------------------------------------------------------------


def test_the_same_seed_makes_the_same_files():
    content = b'{"a": [1, 2, {"b": 3}]}'
    first, second = (
        [mutated(random.Random(k), content, b"a,b\n1,2\n") for k in range(200)] for _ in range(2)
    )
    assert first == second and len(set(first)) > 100


SMALL = (b"", b"\n", b"x", b"a,b\n1,2\n", b"{}", b'{"a": 1}', b"[[[]]]")
MUTATIONS = tuple(dict.fromkeys((*BLIND, *TEXT, of_json)))


@pytest.mark.parametrize("mutate", MUTATIONS, ids=lambda mutate: mutate.__name__)
@pytest.mark.parametrize("content", SMALL)
def test_a_mutation_takes_any_bytes(mutate, content: bytes):
    for seed in range(50):
        assert isinstance(mutate(random.Random(seed), content), bytes)


def _raises(error: BaseException):
    def read(path: Path) -> None:
        raise error

    return read


def _warns(path: Path) -> None:
    warnings.warn("of a library", RuntimeWarning, stacklevel=1)


def _takes_memory(path: Path) -> None:
    bytearray(600 << 20)[:: 1 << 12] = bytes(600 << 8)


def _never_ends(path: Path) -> None:
    while True:
        try:
            sum(range(1000))
        except Exception:
            continue


def test_what_is_wrong_is_seen(monkeypatch: pytest.MonkeyPatch):
    path = Path("x")
    assert trying.fault(lambda path: None, path) is None
    assert trying.fault(_raises(InputError("one line")), path) is None
    assert "KeyError" in str(trying.fault(_raises(KeyError("a")), path))
    assert "of a library" in str(trying.fault(_warns, path))
    with monkeypatch.context() as hasty:
        hasty.setattr(trying, "SECONDS", 0.2)
        assert "takes longer" in str(trying.fault(_never_ends, path))
    empty = InputError("")
    assert "no line" in str(trying.fault(_raises(empty), path))
    free = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if free < 500 << 20:  # else this process has had more already
        assert "MB" in str(trying.fault(_takes_memory, path))


def test_a_fault_is_kept_and_fails_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def build(content: dict, source: str) -> object:
        return content["geometry"]["l"]["value"]

    broken = FileKind("a geometry", {"type": "object"}, build, version=None)
    made = readers()["geometry"]

    def read(path: Path) -> object:
        return path.read_bytes().startswith(b'{"l"') or broken.from_content({}, str(path))

    monkeypatch.setattr("tests.fuzz.__main__.readers", lambda: {"x": type(made)(made.seeds, read)})
    arguments = ["--count", "200", "--failures", str(tmp_path)]
    assert main(arguments) == 1
    kept = sorted(path.name for path in tmp_path.glob("x-0-*/*"))
    assert {"fault.txt", "file.json"} == set(kept)
    assert "KeyError" in next(tmp_path.glob("x-0-*/fault.txt")).read_text()
