"""Every reader of a user's files, with the files that its mutations begin with.

To try another reader, add a line to ``readers``.
"""

from __future__ import annotations

import gzip
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from identification import read_log, write_log
from identification.importing import import_source, open_source, read_map
from tests.identification.healthy import healthy_log
from tests.identification.importing import bags, layouts
from tests.scripts.test_files import KINDS


@dataclass(frozen=True)
class Reader:
    """A reader of files.

    Attributes
    ----------
    seeds : each makes a good file in a folder, and returns its path
    read : reads a file
    """

    seeds: tuple[Callable[[Path], Path], ...]
    read: Callable[[Path], object]


def has(*modules: str) -> bool:
    """Whether optional libraries are installed."""
    return all(importlib.util.find_spec(module) for module in modules)


def readers() -> dict[str, Reader]:
    """All of them by name."""
    found = {name: Reader((_of_kind(kind),), kind.read) for name, kind in KINDS.items()}
    found["log"] = Reader((_log(".csv"), _log(".csv.gz")), read_log)
    found["table"] = Reader(tuple(map(_layout, _layouts())), imported)
    found["map"] = Reader((_map,), read_map)
    found["weights"] = Reader((_weights,), _read_weights)
    found["old weights"] = Reader((_old_weights,), _read_old_weights)
    if has("pyarrow"):
        found["parquet"] = Reader((_log(".parquet"),), read_log)
    if has("rosbags", "mcap"):
        makers = (bags.ros1_bag, bags.lone_db3, bags.mcap_cdr, bags.mcap_json)
        found["bag"] = Reader(tuple(makers), imported)
    return found


def imported(path: Path) -> object:
    """What ``youbot import`` does up to the writing of the log."""
    return import_source(open_source([path]))


def _of_kind(kind: Any) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        kind.write(folder / kind.name)
        return folder / kind.name

    return make


def _log(ending: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / f"log{ending}"
        write_log(path, healthy_log(25.0, 12.0, extras=True))
        return path

    return make


def _layouts() -> list[Callable[[], str]]:
    makers = (getattr(layouts, name) for name in dir(layouts))
    own = [maker for maker in makers if getattr(maker, "__module__", "") == layouts.__name__]
    return [maker for maker in own if not maker.__code__.co_argcount and maker.__name__ != "timed"]


def _layout(text: Callable[[], str]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / "table.csv"
        # The first rows have the layout; all of them would make each try slow.
        path.write_text("".join(text().splitlines(keepends=True)[:300]), "utf-8")
        return path

    return make


def _map(folder: Path) -> Path:
    path = _layout(layouts.plain)(folder)
    text = open_source([path]).map_text
    (folder / "map.toml").write_text(text, "utf-8")
    return folder / "map.toml"


def _weights(folder: Path) -> Path:
    KINDS["policy"].write(folder / "policy.json")
    return folder / "policy.safetensors"


def _read_weights(path: Path) -> object:
    from controllers.policy import policy_file

    return policy_file._unpacked(path.read_bytes(), str(path))


def _old_weights(folder: Path) -> Path:
    import numpy as np

    with (folder / "weights.npz").open("wb") as file:
        np.savez(file, mix=np.eye(3), features=np.ones(4))
    return folder / "weights.npz"


def _read_old_weights(path: Path) -> object:
    from controllers.policy import policy_file

    return policy_file._unpacked_npz(path.read_bytes(), str(path))


def plain_bytes(path: Path) -> bytes:
    """A file's bytes, decompressed where it is a compressed text."""
    content = path.read_bytes()
    return gzip.decompress(content) if path.suffix == ".gz" else content
