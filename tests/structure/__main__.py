"""Prints the size and shape of a checkout: ``python -m tests.structure [CHECKOUT]``.

Lines, files and the longest function by package; circles of files; the longest chain of imports;
tuned numbers that stand in names of their own; comment lines. Tests are left out.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path

from tests.structure.imports import (
    PACKAGES,
    circles,
    import_graph,
    longest_chain,
    source_files,
)


def main(root: Path) -> None:
    graph = import_graph(root)
    print(
        f"{'':16}{'lines':>7}{'files':>7}{'median':>8}{'longest':>9}{'function':>10}"
        f"{'chain':>7}{'constants':>11}{'Any lines':>11}{'comments':>10}"
    )
    for names in (*((package,) for package in PACKAGES), PACKAGES):
        print(_row(root, names, graph))
    rings = circles(graph)
    print(f"\ncircles of files: {len(rings)}")
    for ring in rings:
        print("  " + ", ".join(ring))
    print("\nlongest chain of imports:")
    for name in longest_chain(graph):
        print("  " + name)


def _row(root: Path, packages: tuple[str, ...], graph: dict[str, set[str]]) -> str:
    texts = {name: path.read_text() for name, path in source_files(root, packages).items()}
    lengths = sorted(text.count("\n") for text in texts.values())
    part = {name: targets & texts.keys() for name, targets in graph.items() if name in texts}
    trees = [ast.parse(text) for text in texts.values()]
    label = packages[0] if len(packages) == 1 else "in all"
    lines = sum(lengths)
    comments = sum(comment_lines(text) for text in texts.values())
    uses_any = sum("Any" in line for text in texts.values() for line in text.splitlines())
    return (
        f"{label:16}{lines:7}{len(texts):7}{lengths[len(lengths) // 2]:8}{lengths[-1]:9}"
        f"{max(map(longest_function, trees)):10}{len(longest_chain(part)):7}"
        f"{sum(map(named_constants, trees)):11}{uses_any:11}{comments / lines:10.1%}"
    )


def longest_function(tree: ast.Module) -> int:
    """Lines of the longest function of a file."""
    functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))
    return max(((n.end_lineno or 0) - n.lineno + 1 for n in functions), default=0)


def named_constants(tree: ast.Module) -> int:
    """Numbers at the top of a file that have a name in capitals (tuples of numbers count one)."""
    count = 0
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        named = any(isinstance(t, ast.Name) and t.id.isupper() for t in targets)
        count += named and _is_number(value)
    return count


def _is_number(value: ast.expr) -> bool:
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, ast.Tuple):
        return bool(value.elts) and all(map(_is_number, value.elts))
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def comment_lines(text: str) -> int:
    """Lines that are a comment and nothing else."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(
        token.type == tokenize.COMMENT and token.line.lstrip().startswith("#") for token in tokens
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
