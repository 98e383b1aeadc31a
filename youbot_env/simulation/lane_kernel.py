"""Compiled functions of blocks of rows, of one set of effects: what moves all simulated platforms.

``lane_code`` generates them; this compiles them, keeps them on disk, and moves rows of states by
them. One platform is a batch of one: the same code, and the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import numpy as np

from youbot_env.caching import njit
from youbot_env.physics import inverse_dynamics
from youbot_env.simulation import lane_math
from youbot_env.simulation.compiled import built, load, loaded
from youbot_env.simulation.generated_code import Dynamics, Structure
from youbot_env.simulation.lane_calls import (
    Bound,
    address_of,
    draw_signature,
    on_rows,
    plant_signature,
)
from youbot_env.simulation.lane_code import lane_source
from youbot_env.simulation.lane_draws import DRAWS, draw_source
from youbot_env.simulation.lane_layout import DURATION, LANES, TORQUE
from youbot_env.simulation.lane_math import given, put
from youbot_env.simulation.single_precision import in_single

HEADER = '''"""Generated from the effects' own functions; written again when they change."""

from math import log, sqrt

import numpy as np
from youbot_env.caching import njit
'''

LANE_SOURCES = (
    *(f"youbot_env.simulation.lane_{name}" for name in ("code", "draws", "layout", "program")),
    "youbot_env.simulation.lane_math",
    *("youbot_env.simulation.lane_math_single", "youbot_env.simulation.single_precision"),
    "youbot_env.simulation.lane_calls",
)
"""Modules that generated lanes follow from, whatever they compute: for the cache's key."""


@dataclass(frozen=True)
class Lanes:
    """What the functions of a structure are generated from, for the cache of kernels."""

    prefix: ClassVar[str] = "plant"

    dynamics: Dynamics
    single: bool = False

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that they follow from."""
        own = (__name__, "youbot_env.physics.stated_parameters")
        return (*LANE_SOURCES, *own, self.dynamics.__name__)

    @property
    def variant(self) -> str:
        """What else the generated source depends on."""
        return "single" if self.single else "double"

    def source(self, structure: Structure) -> str:
        """The whole module."""
        parts = lane_source(structure, self.dynamics), draw_source(structure, self.dynamics)
        generated = "\n\n".join(parts)
        if self.single:
            return "\n".join([HEADER, in_single(generated, DRAWS)])
        return "\n".join(
            [HEADER, _imports("youbot_env.simulation.lane_math", lane_math), generated]
        )


def _imports(module: str, found: ModuleType) -> str:
    """An import of what a module itself defines."""
    names = [
        name
        for name, value in vars(found).items()
        if not name.startswith("_")
        and (isinstance(value, (int, type)) or getattr(value, "__module__", "") == module)
    ]
    return f"from {module} import {', '.join(names)}  # noqa\n"


class LaneKernel:
    """Compiled functions of one structure; each compiles at its first use on a machine.

    Attributes
    ----------
    workspace : fields of the workspace ``w``
    """

    def __init__(self, structure: Structure, dynamics: Dynamics, single: bool = False) -> None:
        self._module: ModuleType = built(structure, Lanes(dynamics, single), loaded)
        self._real = np.float32 if single else np.float64
        self.workspace: int = self._module.WORKSPACE

    def address(self, name: str) -> int:
        """Of a function of ``lane_code.lane_source`` or ``lane_draws.draw_source``."""
        signature = draw_signature if name in DRAWS else plant_signature
        return address_of(getattr(self._module, name), signature(self._real))


def stepper(structure: Structure, dynamics: Dynamics = inverse_dynamics) -> Callable[..., None]:
    """A function that moves rows of states on; compiles at the first use on a machine.

    stepper(state, torque, lengths, theta, duration, substeps)
        ``state`` (n, S) moves on in place by ``duration`` [s] under the interface torques
        ``torque`` (n, 4) [N m], held constant. ``lengths``: the mechanism's, in its order;
        ``theta`` (n, P) in the order of ``structure.parameter_names``. All are C-contiguous arrays
        of float64; of others it raises TypeError.
    """
    return built(structure, Lanes(dynamics), _stepper)


def _stepper(structure: Structure, path: Path) -> Callable[..., None]:
    module = load(path)
    integrate = address_of(module.integrate, plant_signature(np.float64))
    found = Bound(move_rows, integrate, module.WORKSPACE)
    mechanism = structure.mechanism
    # Once here, so that a damaged cache shows here, and for these types alone: numbers of an array
    # that does not lie side by side would be read beside it.
    state, torque = np.zeros((1, len(structure.state_names))), np.zeros((1, len(mechanism.joints)))
    theta = np.ones((1, len(structure.parameter_names)))
    found(state, torque, np.ones(len(mechanism.lengths)), theta, 0.0, 1)
    move_rows.disable_compile()
    return found


@njit(cache=True, inner=True, error_model="numpy")
def lay_in_fields(rows, first, lanes, block, field):
    """Rows from the first on into fields of a block, from a field on."""
    count = rows.shape[1]
    for f in range(count):
        for i in range(lanes):
            put(block, (field + f) * LANES + i, given(rows, (first + i) * count + f))


@njit(cache=True, error_model="numpy", nogil=True)
def move_rows(integrate, workspace, state, torque, lengths, theta, duration, substeps):
    """See ``stepper``."""
    # A block at a time, whose numbers stay in the caches.
    x = np.empty((state.shape[1] + theta.shape[1]) * LANES)
    w = np.empty(workspace * LANES)
    for i in range(min(LANES, len(state))):
        w[DURATION * LANES + i] = duration / substeps
    for first in range(0, len(state), LANES):
        lanes = min(LANES, len(state) - first)
        lay_in_fields(state, first, lanes, x, 0)
        lay_in_fields(theta, first, lanes, x, state.shape[1])
        lay_in_fields(torque, first, lanes, w, TORQUE)
        on_rows(integrate, x, w, w, lanes, substeps, lengths)
        for f in range(state.shape[1]):
            for i in range(lanes):
                put(state, (first + i) * state.shape[1] + f, given(x, f * LANES + i))
