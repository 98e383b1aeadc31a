"""Which file imports which, read from the source of a checkout; nothing of it is run.

Every import counts, also one inside a function or under ``TYPE_CHECKING``. A name that a package's
``__init__`` hands on is followed to the file that defines it, so these files stand aside.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("youbot_env", "identification", "controllers", "scripts")
"""The packages, each a folder of the checkout."""

INSTALLED_AS = {"youbot_scripts": "scripts"}
"""Packages that are installed under another name than their folder's."""


def source_files(root: Path, packages: tuple[str, ...] = PACKAGES) -> dict[str, Path]:
    """Python files of some packages by dotted module name (``package.folder.file``)."""
    found = {}
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def is_face(path: Path) -> bool:
    """Whether a file is a package's ``__init__``."""
    return path.name == "__init__.py"


def import_graph(root: Path) -> dict[str, set[str]]:
    """For each file (``__init__`` aside) the files that it imports, by dotted module name."""
    files = source_files(root)
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in files.items()}
    faces = {name: handed_on(path, name) for name, path in files.items() if is_face(path)}
    graph = {}
    for name, path in files.items():
        if is_face(path):
            continue
        targets = {_resolved(module, files, faces) for module in imported_modules(trees[name])}
        graph[name] = {target for target in targets if target} - {name}
    return graph


def imported_modules(tree: ast.AST) -> Iterator[str]:
    """What a file imports as dotted names: ``from a.b import c`` is ``a.b.c``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def handed_on(face: Path, package: str) -> dict[str, str]:
    """Names that an ``__init__`` or its stub hands on, with the dotted name of what each one is."""
    names = {}
    for path in (face, face.with_suffix(".pyi")):
        tree = ast.parse(path.read_text(encoding="utf-8")) if path.exists() else ast.Module([], [])
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = f"{package}.{node.module}" if node.level else node.module
                for alias in node.names:
                    names[alias.asname or alias.name] = f"{module}.{alias.name}"
    return names


def _resolved(dotted: str, files: dict[str, Path], faces: dict[str, dict[str, str]]) -> str | None:
    """The file that a dotted name stands in: ``a.b.c`` is a file, or a name in file ``a.b``."""
    head, _, rest = dotted.partition(".")
    dotted = f"{INSTALLED_AS.get(head, head)}.{rest}" if rest else INSTALLED_AS.get(head, head)
    if dotted in files:
        return None if is_face(files[dotted]) else dotted
    module, _, name = dotted.rpartition(".")
    if module not in files:
        return None
    if not is_face(files[module]):
        return module
    home = faces[module].get(name)
    return _resolved(home, files, faces) if home and home != dotted else None


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of files that import each other in a loop (strongly connected components)."""
    return [sorted(group) for group in _components(graph) if len(group) > 1]


def longest_chain(graph: dict[str, set[str]]) -> list[str]:
    """Files of the longest chain of imports, from the importer down; a circle counts as one."""
    group_of = {name: tuple(sorted(group)) for group in _components(graph) for name in group}
    below: dict[tuple[str, ...], list[str]] = {}

    def chain(group: tuple[str, ...]) -> list[str]:
        if group not in below:
            next_groups = {group_of[target] for name in group for target in graph.get(name, ())}
            chains = [chain(other) for other in sorted(next_groups - {group})]
            below[group] = [group[0], *max(chains, key=len, default=[])]
        return below[group]

    return max((chain(group) for group in sorted(set(group_of.values()))), key=len, default=[])


def _components(graph: dict[str, set[str]]) -> list[set[str]]:
    """Strongly connected components (Tarjan 1972)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(name: str) -> None:
        number[name] = low[name] = len(number)
        stack.append(name)
        for target in sorted(graph.get(name, ())):
            if target not in number:
                visit(target)
                low[name] = min(low[name], low[target])
            elif target in stack:
                low[name] = min(low[name], number[target])
        if low[name] == number[name]:
            at = stack.index(name)
            found.append(set(stack[at:]))
            del stack[at:]

    for name in sorted(graph):
        if name not in number:
            visit(name)
    return found
