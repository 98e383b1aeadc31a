"""The batch's own source as functions of a GPU: the same lines, compiled for another machine.

A thread is a block of one row: it gets every array from its own lane on, so that loops over lanes
turn once, and threads that stand side by side read numbers that stand side by side. What differs is
what a function is decorated with, the few operations that have another name there, and that a
platform's functions are called by name, where the processor's code calls them by address.
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.util
import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from youbot_env.physics import inverse_dynamics
from youbot_env.simulation.generated_code import Structure
from youbot_env.simulation.lane_kernel import Lanes
from youbot_env.simulation.single_precision import in_single
from youbot_env.tracking import period, period_lanes

OF_PLATFORM = {
    "INTEGRATE": "integrate",
    "RATES": "joint_rates",
    "ACTING": "acting",
    "SHIFTS": "shifts",
    "DRAWN": "drawn",
}
"""Functions of a platform by the names of their places in the list of addresses."""

BY_ADDRESS = ("on_rows", "on_parameters")
"""What calls them."""

ROUNDED = ("floor", "rint", "sqrt")
"""Functions of numpy that have another name on a GPU."""

SHARED = (
    "youbot_env.simulation.lane_math",
    "youbot_env.simulation.lane_math_single",
    "youbot_env.simulation.lane_calls",
    "youbot_env.tracking.random_numbers",
    "youbot_env.tracking.episode_draws",
    "youbot_env.tracking.period_lanes",
    "youbot_env.tracking.period",
)
"""Modules whose functions are compiled for the GPU as well."""


class DeviceCode:
    """Modules of the batch for one structure, as functions of a GPU.

    Parameters
    ----------
    structure : of the platforms
    single : whether they are in single precision
    device : decorates a function that a GPU's functions call
    operations : by name, what stands for ``fma``, ``bits_of``, ``floor`` ... there

    Attributes
    ----------
    period : the module with all functions of a control period
    """

    def __init__(
        self,
        structure: Structure,
        single: bool,
        device: Callable[[Any], Any],
        operations: dict[str, Any],
    ) -> None:
        self._single, self._device, self._operations = single, device, operations
        self._modules: dict[str, ModuleType] = {}
        plant = Lanes(inverse_dynamics, single).source(structure)
        self._plant = self._module("plant", plant)
        self.period = self._module("period", self._period_source())

    def in_python(self, name: str) -> ModuleType:
        """One of the shared modules as plain functions of Python, for what is done once."""
        return _InPython()._of(name)

    def _period_source(self) -> str:
        both = inspect.getsource(period_lanes) + inspect.getsource(period)
        return in_single(both, within=(period_lanes.__name__,)) if self._single else both

    def _of(self, name: str) -> ModuleType:
        """One of the shared modules."""
        if name not in self._modules:
            found = importlib.import_module(name)
            self._modules[name] = self._module(name, inspect.getsource(found))
        return self._modules[name]

    def _module(self, name: str, source: str) -> ModuleType:
        space: dict[str, Any] = {"device": self._device, "np": np}
        if name == "period":
            space |= {of: getattr(self._plant, of) for of in OF_PLATFORM.values()}
        rest = []
        for statement in ast.parse(source).body:
            if isinstance(statement, ast.ImportFrom) and statement.module == "__future__":
                continue
            if isinstance(statement, ast.Import):
                rest += self._imported(statement, space)
            elif isinstance(statement, ast.ImportFrom):
                rest += self._taken(statement, space)
            elif not _is_made_by_compiler(statement):
                rest.append(_OfDevice().visit(statement))
        space |= self._operations
        # Annotations name what is not made there: they stay text.
        text = ast.unparse(ast.fix_missing_locations(ast.Module(rest, [])))
        source = f"from __future__ import annotations\n{text}"
        return _loaded(f"youbot_env.gpu.{name.rsplit('.', 1)[-1]}", source, space)

    def _imported(self, statement: ast.Import, space: dict[str, Any]) -> list[ast.stmt]:
        kept = []
        for alias in statement.names:
            if alias.name in SHARED and alias.asname:
                space[alias.asname] = self._of(alias.name)
            else:
                kept.append(alias)
        return [ast.Import(kept)] if kept else []

    def _taken(self, statement: ast.ImportFrom, space: dict[str, Any]) -> list[ast.stmt]:
        kept = []
        for alias in statement.names:
            name, shown = f"{statement.module}.{alias.name}", alias.asname or alias.name
            if name in SHARED:
                space[shown] = self._of(name)
            elif statement.module == "youbot_env.tracking.period_lanes":
                continue  # what they define stands in the same source, or is numbers
            elif statement.module in SHARED:
                taken = vars(self._of(statement.module))
                chosen = taken if alias.name == "*" else {shown: taken.get(alias.name)}
                space |= {k: v for k, v in chosen.items() if not k.startswith("_")}
            else:
                kept.append(alias)
        return [ast.ImportFrom(statement.module, kept, statement.level)] if kept else []


class _Made(importlib.abc.InspectLoader):
    """Gives a module's source, which stands in no file."""

    def __init__(self, source: str) -> None:
        self._source = source

    def get_source(self, fullname: str) -> str:
        """The text."""
        return self._source


def _loaded(name: str, source: str, known: dict[str, Any]) -> ModuleType:
    """A module of this package's own source, in which names are known already."""
    spec = importlib.util.spec_from_loader(name, _Made(source))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    vars(module).update(known)
    spec.loader.exec_module(module)
    return module


def _is_made_by_compiler(statement: ast.stmt) -> bool:
    """Whether a name is one of the compiler's own operations."""
    value = getattr(statement, "value", None)
    made = isinstance(statement, ast.AnnAssign) and isinstance(value, ast.Call)
    return made and getattr(value.func, "id", "") == "intrinsic"  # pyright: ignore


class _OfDevice(ast.NodeTransformer):
    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        found = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
        if any(getattr(one, "id", "") == "njit" for one in found):
            node.decorator_list = [ast.Name("device", ast.Load())]
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        # A view of other shape is a function of the C library; ``given`` counts through all axes.
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            return node.func.value
        called = getattr(node.func, "id", "")
        if called in BY_ADDRESS and isinstance(node.args[0], ast.Subscript):
            place = node.args[0].slice
            assert isinstance(place, ast.Name)
            node.func, node.args = ast.Name(OF_PLATFORM[place.id], ast.Load()), node.args[1:]
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.value, ast.Name) and node.value.id == "np" and node.attr in ROUNDED:
            return ast.copy_location(ast.Name(node.attr, node.ctx), node)
        return node


class _InPython(DeviceCode):
    """The shared modules without a compiler."""

    def __init__(self) -> None:
        self._single, self._device = False, lambda function: function
        self._operations, self._modules = {}, {}
