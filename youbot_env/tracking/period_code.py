"""The compiled control period of a structure: generated plant, and the task around it.

The task is the same for all platforms and compiled once on a machine (``tracking.period``); it
calls what follows from a set of effects by address.
"""

from __future__ import annotations

import ctypes
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from youbot_env.physics import inverse_dynamics
from youbot_env.physics.effect import CLOCK
from youbot_env.simulation.compiled import built, loaded
from youbot_env.simulation.generated_code import Structure
from youbot_env.simulation.lane_calls import address_of, beginnings_signature, period_signature
from youbot_env.simulation.lane_kernel import LANE_SOURCES, LaneKernel
from youbot_env.simulation.single_precision import in_single
from youbot_env.tracking import period, period_lanes as lanes


@dataclass(frozen=True)
class SinglePeriod:
    """What the period of all structures in single precision is made from."""

    prefix: ClassVar[str] = "period"
    variant: ClassVar[str] = "single"
    sources: ClassVar[tuple[str, ...]] = (
        *(*LANE_SOURCES, "youbot_env.tracking.period", "youbot_env.tracking.period_lanes"),
        *("youbot_env.tracking.random_numbers", "youbot_env.tracking.episode_draws"),
    )

    def source(self, structure: None) -> str:
        """The whole module."""
        both = inspect.getsource(lanes) + inspect.getsource(period)
        return in_single(both, within=(lanes.__name__,))


@dataclass(frozen=True)
class PeriodKernel:
    """Compiled functions of one structure.

    begin_rows : called with addresses, see ``tracking.period``; holds no lock of Python's meanwhile
    period : address of that function, for a call (``handover``) and for threads
    plant : what moves
    """

    begin_rows: Callable[[int, int, int, int, int], int]
    period: int
    plant: LaneKernel
    _begin_address: int
    _late: bool

    def addresses(self, draws: bool) -> NDArray[np.int64]:
        """Of functions, as ``period_lanes`` numbers them; compiles them if need be.

        ``draws``: whether models are drawn.
        """
        found = np.zeros(lanes.PLACES - lanes.PLACE * lanes.PLANT, np.int64)
        found[lanes.INTEGRATE] = self.plant.address("integrate")
        found[lanes.RATES] = self.plant.address("joint_rates")
        found[lanes.ACTING] = self.plant.address("acting")
        if self._late:
            found[lanes.SHIFTS] = self.plant.address("shifts")
        if draws:
            found[lanes.DRAWN] = self.plant.address("drawn")
        found[lanes.BEGIN_ROWS] = self._begin_address
        return found


def period_kernel(structure: Structure, single: bool = False) -> PeriodKernel:
    """The compiled control period of a structure; compiles at the first use on a machine."""
    task = built(None, SinglePeriod(), loaded) if single else period
    begin = address_of(task.begin_rows, beginnings_signature(np.float32 if single else np.float64))
    whole, place = ctypes.c_int64, ctypes.c_void_p
    return PeriodKernel(
        ctypes.CFUNCTYPE(whole, place, place, place, whole, whole)(begin),
        address_of(task.period, period_signature()),
        LaneKernel(structure, inverse_dynamics, single),
        begin,
        bool(structure.at(CLOCK)),
    )
