"""The layout of the code: which arrows may run, no circle, no long chain of imports."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from tests.structure.imports import (
    PACKAGES,
    circles,
    import_graph,
    is_face,
    longest_chain,
    source_files,
)

ROOT = Path(__file__).parents[2]


# Not when the file is imported: each process of a parallel run imports all files.
@cache
def graph_of_all() -> dict[str, set[str]]:
    return import_graph(ROOT)


ANY_OTHER = "any other room"

MAY_IMPORT = {
    "youbot_env": {
        "errors": set(),
        "files": {"errors"},
        "caching": set(),
        "physics": {"errors", "files", "caching"},
        "model": {"physics"},
        "simulation": {"model"},
        "contact": {"simulation"},
        "exports": {"contact"},
        "motions": {"physics"},
        "threads": {"errors"},
        "tracking": {"motions", "contact", "threads"},
        "sb3": {"tracking"},
        "gpu": {"tracking"},
        "precompile": {"tracking"},
        "equations": {"physics", "model"},
        "plugins": {"equations"},
    },
    "identification": {
        "signals": set(),
        "threads": set(),
        "showing": set(),
        "kinematics": {"signals"},
        "logs": {"kinematics"},
        "importing": {"logs"},
        "mechanisms": {"logs", "threads"},
        "fitting": {"mechanisms", "showing"},
        "residual_map": {"fitting"},
        "proposal": {"residual_map"},
        "diagnosis": {"proposal"},
        "comparison": {"residual_map"},
        "doctor": {"fitting"},
        "figures": {"diagnosis", "comparison"},
    },
    "controllers": {
        "interface": set(),
        "allocation": set(),
        "loop": {"interface", "allocation"},
        "linear": {"loop"},
        ANY_OTHER: {"linear"},
        "recording": {ANY_OTHER},
        "tuning": {ANY_OTHER},
        "registry": {"tuning", "recording"},
    },
}
"""For each room (a folder, or a file beside the folders) the rooms that it may import, and with
them all that those may import. A controller is a room that has no line of its own."""

PACKAGE_ORDER = PACKAGES
"""A package imports only from those that stand before it."""

LONGEST_CHAIN = {"identification": 9, "in all": 14}
"""Files in the longest chain of imports, package faces aside."""


def room(module: str) -> tuple[str, str]:
    """Package and room of a file: the folder that it stands in, or the file itself."""
    package, name, *_ = module.split(".")
    return package, name


def line_of(package: str, name: str) -> str:
    """The line of ``MAY_IMPORT`` that a room goes by."""
    lines = MAY_IMPORT[package]
    return name if name in lines else ANY_OTHER


def allowed(package: str, name: str) -> set[str]:
    """Lines of the rooms that a room may import: those of its own, and what they may import."""
    direct = MAY_IMPORT[package][line_of(package, name)]
    return direct.union(*(allowed(package, other) for other in direct))


def test_every_room_has_its_line():
    for package, rooms in MAY_IMPORT.items():
        found = {room(module)[1] for module in graph_of_all() if module.startswith(f"{package}.")}
        if ANY_OTHER in rooms:
            found = {line_of(package, name) for name in found}
        assert found == set(rooms), f"a new file or folder in {package} needs a line in MAY_IMPORT"


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_rooms_import_only_what_stands_to_their_left(package: str):
    strangers = [
        f"{module} imports {target}"
        for module, targets in graph_of_all().items()
        for target in targets
        if room(module)[0] == room(target)[0] == package
        and room(module) != room(target)
        and line_of(*room(target)) not in allowed(*room(module))
    ]
    assert not strangers


def test_packages_import_only_what_stands_before_them():
    order = PACKAGE_ORDER.index
    strangers = [
        f"{module} imports {target}"
        for module, targets in graph_of_all().items()
        for target in targets
        if order(room(target)[0]) > order(room(module)[0])
    ]
    assert not strangers


def test_no_files_import_each_other_in_a_circle():
    assert circles(graph_of_all()) == []


def test_no_chain_of_imports_is_long():
    inside = {
        module: {target for target in targets if target.startswith("identification.")}
        for module, targets in graph_of_all().items()
        if module.startswith("identification.")
    }
    for name, graph in (("identification", inside), ("in all", graph_of_all())):
        chain = longest_chain(graph)
        assert len(chain) <= LONGEST_CHAIN[name], " -> ".join(chain)


def test_every_folder_says_what_lives_in_it():
    for path in source_files(ROOT).values():
        if is_face(path):
            assert path.read_text(encoding="utf-8").startswith('"""'), path


def test_the_graph_follows_names_through_faces(tmp_path: Path):
    """A circle through a face, an import in a function, and one under TYPE_CHECKING all count."""
    sources = {
        "youbot_env/__init__.py": "",
        "youbot_env/__init__.pyi": "from .low import thing as thing\n",
        "youbot_env/low.py": "def f():\n    from youbot_env.high import other\nthing = 1\n",
        "youbot_env/high.py": "from youbot_env import thing\nother = thing\n",
        "youbot_env/alone.py": (
            "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from youbot_env.high import other\n"
        ),
    }
    (tmp_path / "youbot_env").mkdir()
    for name, text in sources.items():
        (tmp_path / name).write_text(text)
    graph = import_graph(tmp_path)
    assert graph["youbot_env.alone"] == {"youbot_env.high"}
    assert circles(graph) == [["youbot_env.high", "youbot_env.low"]]
    assert longest_chain(graph)[0] == "youbot_env.alone"
