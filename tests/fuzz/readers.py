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
from identification.kinematics import estimate_kinematics
from identification.logs.motion_reading import read_motion
from tests.identification.healthy import healthy_log
from tests.identification.importing import bags, layouts
from tests.scripts.test_files import KINDS
from youbot_env.files import write_json
from youbot_env.model.model_file import geometry_to_dict, load_geometry
from youbot_env.physics.geometry import Geometry
from youbot_scripts.interactive.project import Project, Step


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
    found["import by a map"] = Reader((_map,), _imported_by)
    found["kinematics"] = Reader((_log(".csv"), _log(".csv.gz")), _lengths)
    found["other wheels"] = Reader((_other_wheels,), load_geometry)
    found["project"] = Reader((_project,), lambda path: Project.open(path.parents[1], "", []))
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


def _imported_by(path: Path) -> object:
    """``youbot import table.csv --map map.toml``: the map is the file that is mutated."""
    return import_source(open_source([path.with_name("table.csv")], read_map(path)))


def _lengths(path: Path) -> object:
    """``youbot kinematics``."""
    motion, _ = read_motion(path)
    return estimate_kinematics([motion])


def _other_wheels(folder: Path) -> Path:
    geometry = Geometry(arrangement="O", roller_angles=(0.7, 0.8, 0.7, 0.8), torque_limit=3.0)
    write_json(folder / "geometry.json", {"geometry": geometry_to_dict(geometry)})
    return folder / "geometry.json"


def _project(folder: Path) -> Path:
    (folder / "runs").mkdir(exist_ok=True)
    project = Project.open(folder / "runs", "", ["a.csv"])
    project.steps.append(Step(1, "doctor", "Check", ["doctor", "a.csv"], "1.json", share=0.5))
    project.changed()
    return project.home / "project.json"


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
