"""Mutated files are read, or refused in one line: a few each time, a minute in the slow tests."""

from __future__ import annotations

import random
import resource
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from tests.fuzz import trying
from tests.fuzz.__main__ import corpus, main, seeds, try_out
from tests.fuzz.mutations import BLIND, TEXT, mutated, of_json
from tests.fuzz.readers import has, readers
from tests.identification.healthy import healthy_log
from tests.identification.importing import bags
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


BAGS = range(len(readers()["bag"].seeds) if "bag" in NAMES else 0)
NEEDS_BAGS = pytest.mark.skipif(not has("rosbags", "mcap"), reason="needs the extra for bags")


def cut_bags_are_read_or_refused(number: int, folder: Path, sizes: Callable[[int], Iterable[int]]):
    """A seed bag that ends after each of some numbers of its bytes."""
    reader = readers()["bag"]
    path = reader.seeds[number](folder)
    whole = path.read_bytes()
    for size in sizes(len(whole)):
        path.write_bytes(whole[:size])
        assert trying.fault(reader.read, path) is None, size


@NEEDS_BAGS
@pytest.mark.parametrize("number", BAGS)
def test_a_bag_that_is_cut_is_read_or_refused(number: int, tmp_path: Path):
    cut_bags_are_read_or_refused(number, tmp_path, lambda size: range(7, size, max(1, size // 12)))


@pytest.mark.slow
@NEEDS_BAGS
@pytest.mark.parametrize("number", BAGS)
def test_a_bag_that_is_cut_anywhere_is_read_or_refused(number: int, tmp_path: Path):
    ends = lambda size: {*range(min(200, size)), *range(max(size - 200, 0), size)}  # noqa: E731
    cut_bags_are_read_or_refused(
        number,
        tmp_path,
        lambda size: sorted(ends(size) | set(range(0, size, max(1, size // 200)))),
    )


@pytest.mark.slow
@NEEDS_BAGS
@pytest.mark.parametrize("make", [bags.ros1_bag, bags.mcap_cdr], ids=["ros1", "mcap"])
def test_a_short_bag_that_is_cut_at_any_byte_is_read_or_refused(
    make: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Three rows: all that a format has in it, and few enough bytes to try every one."""
    few = healthy_log(duration=0.03, extras=True)
    monkeypatch.setattr(bags, "LOG", few)
    for function in (bags.instants, bags.poses):
        monkeypatch.setattr(function, "__defaults__", (few,))
    path = make(tmp_path)
    whole = path.read_bytes()
    read = readers()["bag"].read
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        assert trying.fault(read, path) is None, size


# --- the fuzzer itself -----------------------------------------------------------------------


def test_the_same_seed_makes_the_same_files():
    content = b'{"a": [1, 2, {"b": 3}]}'
    first, second = (
        [mutated(random.Random(k), content, b"a,b\n1,2\n") for k in range(200)] for _ in range(2)
    )
    assert first == second and len(set(first)) > 100


SMALL = (b"\x1f\x8b\x08junk", b"", b"\n", b"x", b"a,b\n1,2\n", b"{}", b'{"a": 1}', b"[[[]]]")
MUTATIONS = tuple(dict.fromkeys((*BLIND, *TEXT, of_json)))


@pytest.mark.parametrize("mutate", MUTATIONS, ids=lambda mutate: mutate.__name__)
@pytest.mark.parametrize("content", SMALL)
def test_a_mutation_takes_any_bytes(mutate, content: bytes):
    for seed in range(50):
        assert isinstance(mutate(random.Random(seed), content), bytes)
        assert isinstance(mutated(random.Random(seed), content, b"a"), bytes)


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
