"""The compiled control period of a structure: generated plant, and the task around it.

The task is the same for all platforms and compiled once on a machine (``tracking.period``); it
calls what follows from a set of effects by address.
"""

from __future__ import annotations

import ctypes
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from youbot_env.physics import inverse_dynamics
from youbot_env.physics.effect import CLOCK
from youbot_env.simulation import lane_math
from youbot_env.simulation.compiled import built, load
from youbot_env.simulation.generated_code import Dynamics, Structure
from youbot_env.simulation.lane_calls import (
    address_of,
    beginnings_signature,
    draw_signature,
    period_signature,
    plant_signature,
)
from youbot_env.simulation.lane_code import DRAWS, lane_source
from youbot_env.simulation.single_precision import in_single
from youbot_env.tracking import period, period_lanes as lanes

HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import log, sqrt

import numpy as np
from youbot_env.caching import njit
'''

PRECISION_SOURCES = (
    *("youbot_env.simulation.lane_code", "youbot_env.simulation.lane_math"),
    *("youbot_env.simulation.lane_math_single", "youbot_env.simulation.single_precision"),
    "youbot_env.simulation.lane_calls",
)


@dataclass(frozen=True)
class Plant:
    """What the functions of a structure are generated from, for the cache of kernels."""

    prefix: ClassVar[str] = "plant"

    dynamics: Dynamics
    single: bool = False

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that they follow from."""
        own = ("youbot_env.tracking.period_code", "youbot_env.physics.stated_parameters")
        return (*PRECISION_SOURCES, *own, self.dynamics.__name__)

    @property
    def variant(self) -> str:
        """What else the generated source depends on."""
        return "single" if self.single else "double"

    def source(self, structure: Structure) -> str:
        """The whole module."""
        generated = lane_source(structure, self.dynamics)
        if self.single:
            return "\n".join([HEADER, in_single(generated, DRAWS)])
        return "\n".join(
            [HEADER, _imports("youbot_env.simulation.lane_math", lane_math), generated]
        )


@dataclass(frozen=True)
class SinglePeriod:
    """What the period of all structures in single precision is made from."""

    prefix: ClassVar[str] = "period"
    variant: ClassVar[str] = "single"
    sources: ClassVar[tuple[str, ...]] = (
        *(*PRECISION_SOURCES, "youbot_env.tracking.period", "youbot_env.tracking.period_lanes"),
        *("youbot_env.tracking.random_numbers", "youbot_env.tracking.episode_draws"),
    )

    def source(self, structure: None) -> str:
        """The whole module."""
        both = inspect.getsource(lanes) + inspect.getsource(period)
        return in_single(both, within=(lanes.__name__,))


def _imports(module: str, found: ModuleType) -> str:
    """An import of what a module itself defines."""
    names = [
        name
        for name, value in vars(found).items()
        if not name.startswith("_")
        and (isinstance(value, (int, type)) or getattr(value, "__module__", "") == module)
    ]
    return f"from {module} import {', '.join(names)}  # noqa\n"


@dataclass(frozen=True)
class PeriodKernel:
    """Compiled functions of one structure.

    begin_rows : called with addresses, see ``tracking.period``; holds no lock of Python's meanwhile
    period : address of that function, for a call (``handover``) and for threads
    workspace : fields of the workspace ``w``
    """

    begin_rows: Callable[[int, int, int, int, int], int]
    period: int
    workspace: int
    _begin_address: int
    _plant: ModuleType
    _signatures: tuple[Any, Any]
    _late: bool

    def addresses(self, draws: bool) -> NDArray[np.int64]:
        """Of functions, as ``period_lanes`` numbers them; compiles them if need be.

        ``draws``: whether models are drawn.
        """
        rows, parameters = self._signatures
        found = np.zeros(lanes.PLACES - lanes.PLACE * lanes.PLANT, np.int64)
        found[lanes.INTEGRATE] = address_of(self._plant.integrate, rows)
        found[lanes.RATES] = address_of(self._plant.joint_rates, rows)
        found[lanes.ACTING] = address_of(self._plant.acting, rows)
        if self._late:
            found[lanes.SHIFTS] = address_of(self._plant.shifts, rows)
        if draws:
            found[lanes.DRAWN] = address_of(self._plant.drawn, parameters)
        found[lanes.BEGIN_ROWS] = self._begin_address
        return found


def period_kernel(structure: Structure, single: bool = False) -> PeriodKernel:
    """The compiled control period of a structure; compiles at the first use on a machine."""
    task = built(None, SinglePeriod(), _loaded) if single else period
    plant: ModuleType = built(structure, Plant(inverse_dynamics, single), _loaded)
    real = np.float32 if single else np.float64
    begin = address_of(task.begin_rows, beginnings_signature(real))
    whole, place = ctypes.c_int64, ctypes.c_void_p
    return PeriodKernel(
        ctypes.CFUNCTYPE(whole, place, place, place, whole, whole)(begin),
        address_of(task.period, period_signature()),
        plant.WORKSPACE,
        begin,
        plant,
        (plant_signature(real), draw_signature(real)),
        bool(structure.at(CLOCK)),
    )


def _loaded(structure: Structure | None, path: Path) -> ModuleType:
    return load(path)
