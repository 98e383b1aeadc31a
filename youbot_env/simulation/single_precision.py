"""Source in single precision from source in double: numbers written in it become ``real``."""

from __future__ import annotations

import ast
from collections.abc import Collection

from youbot_env.simulation import lane_math, lane_math_single

_DOUBLE, _SINGLE_MATH = lane_math.__name__, lane_math_single.__name__


def in_single(source: str, doubles: Collection[str] = (), within: Collection[str] = ()) -> str:
    """Source whose floating point constants are ``real``, but for those of functions ``doubles``.

    Imports of ``lane_math`` become those of ``lane_math_single``, whose ``real`` it is; functions
    that stay in double precision find theirs in ``lane_math`` itself. Modules ``within`` are not
    imported: what they define stands in the source.
    """
    tree = ast.parse(source)
    body, left_out = [], ("__future__", _DOUBLE, *within)
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom) and statement.module in left_out:
            continue
        if isinstance(statement, ast.FunctionDef) and statement.name in doubles:
            statement = _OwnFunctions().visit(statement)
        else:
            statement = _Single().visit(statement)
        body.append(statement)
    shared = ast.parse(
        f"import {_DOUBLE} as double\n"
        f"from {_DOUBLE} import fetch, fma, given, pointer, put, taken_before\n"
        f"from {_SINGLE_MATH} import *\n"
    ).body
    return ast.unparse(ast.fix_missing_locations(ast.Module([*shared, *body], [])))


class _Single(ast.NodeTransformer):
    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if isinstance(node.value, float):
            return ast.Call(ast.Name("real", ast.Load()), [node], [])
        return node


class _OwnFunctions(ast.NodeTransformer):
    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in ("sin", "cos", "exp", "tanh"):
            node.func = ast.Attribute(ast.Name("double", ast.Load()), node.func.id, ast.Load())
        return node
