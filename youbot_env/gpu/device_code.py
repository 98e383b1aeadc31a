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
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

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
)
"""Modules whose functions are compiled for the GPU as well."""


def device_period(structure: Structure, single: bool, modules: DeviceModules) -> ModuleType:
    """All functions of a control period, for a structure in single or double precision."""
    plant = modules.made("plant", Lanes(inverse_dynamics, single).source(structure))
    both = inspect.getsource(period_lanes) + inspect.getsource(period)
    source = in_single(both, within=(period_lanes.__name__,)) if single else both
    known = {name: getattr(plant, name) for name in OF_PLATFORM.values()}
    return modules.made("period", source, known)


class DeviceModules:
    """This package's modules as functions of a GPU, each made at its first use.

    Parameters
    ----------
    device : decorates a function that a GPU's functions call
    operations : by name, what stands for ``fma``, ``bits_of``, ``floor`` ... there
    """

    def __init__(self, device: Callable[[Any], Any], operations: dict[str, Any]) -> None:
        self._device, self._operations = device, operations
        self._shared: dict[str, ModuleType] = {}

    def shared(self, name: str) -> ModuleType:
        """One of ``SHARED``."""
        if name not in self._shared:
            source = inspect.getsource(importlib.import_module(name))
            self._shared[name] = self.made(name.rsplit(".", 1)[-1], source)
        return self._shared[name]

    def made(self, name: str, source: str, known: Mapping[str, Any] | None = None) -> ModuleType:
        """A module of some source, in which names of ``known`` stand for these things."""
        space: dict[str, Any] = {"device": self._device, **(known or {})}
        rest: list[ast.stmt] = []
        for statement in ast.parse(source).body:
            if isinstance(statement, ast.Import):
                rest += self._imported(statement, space)
            elif isinstance(statement, ast.ImportFrom):
                rest += self._taken(statement, space)
            elif not _is_made_by_compiler(statement):
                rest.append(_OfDevice().visit(statement))
        # Annotations name what is not made there: they stay text.
        text = ast.unparse(ast.fix_missing_locations(ast.Module(rest, [])))
        source = f"from __future__ import annotations\n{text}"
        return _loaded(f"youbot_env.gpu.{name}", source, space | self._operations)

    def _imported(self, statement: ast.Import, space: dict[str, Any]) -> list[ast.stmt]:
        """What is left of an import: shared modules are in ``space`` then."""
        kept = []
        for alias in statement.names:
            if alias.name in SHARED and alias.asname:
                space[alias.asname] = self.shared(alias.name)
            else:
                kept.append(alias)
        return [ast.Import(kept)] if kept else []

    def _taken(self, statement: ast.ImportFrom, space: dict[str, Any]) -> list[ast.stmt]:
        """The same of an import of names."""
        # What ``period`` takes from its lanes stands in the same source.
        if statement.module in ("__future__", period_lanes.__name__):
            return []
        kept = []
        for alias in statement.names:
            name, shown = f"{statement.module}.{alias.name}", alias.asname or alias.name
            if name in SHARED:
                space[shown] = self.shared(name)
            elif statement.module in SHARED:
                taken = vars(self.shared(statement.module))
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
