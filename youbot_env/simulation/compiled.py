"""Compiled steppers: generated source, compiled by numba, cached on disk per set of effects."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

import youbot_env
from youbot_env.caching import cache_folder, is_safe, private_folder
from youbot_env.physics import inverse_dynamics
from youbot_env.simulation import inverse_loops, runge_kutta
from youbot_env.simulation.generated_code import (
    MOTION,
    SOURCES,
    Dynamics,
    Inverse,
    Structure,
    System,
)
from youbot_env.simulation.lane_calls import (
    Bound,
    address_of,
    numbers_signature,
    rates_signature,
)

Array = NDArray[np.float64]


class Generated(Protocol):
    """What a module is generated from, beside a structure. A value of it can be hashed.

    Attributes
    ----------
    prefix : of the file's name
    sources : modules that the code follows from, beside ``SOURCES``
    variant : what else it depends on
    """

    prefix: ClassVar[str]

    @property
    def sources(self) -> tuple[str, ...]: ...
    @property
    def variant(self) -> str: ...
    def source(self, structure: Any) -> str: ...


@dataclass(frozen=True)
class InverseKernel:
    """Compiled inverse dynamics for one set of effects.

    acting(motion, lengths, theta, tolerance, torque)
        Least-norm torques that act at the wheels, ``torque`` (n, 4) [N m], which motions (n, 14)
        demand: rows as ``inverse.MOTION``. Torques that depend on themselves (losses under load)
        are sought, from the values that ``torque`` comes with, until they move by no more than
        ``tolerance`` [N m] in sum.
    several(motion, lengths, thetas, tolerance, torque)
        The same, ``torque`` (k, n, 4), at each of several parameters ``thetas`` (k, P).
    interface(torque, rate, second, motion, lengths, theta, out)
        Interface torques ``out`` (4,) behind which ``torque`` (4,) acts and changes at ``rate``
        (4,) [N m/s], and that at ``second`` (4,) [N m/s^2], in a motion (14,); they belong to a
        time earlier by ``Model.delay``.
    held(motion, hold, lengths, theta, tolerance, torque, mean, out)
        The interface torques ``out`` (4,) that, held for ``hold`` [s], do best what the motions
        (3, 14) at the start, the middle and the end of the hold demand: they make the mean (4,) of
        the acting torques (Simpson's rule), their mean rate and their second difference.
        ``torque`` (3, 4) as above.
    """

    structure: Structure
    acting: Callable[..., None]
    several: Callable[..., None]
    interface: Callable[..., None]
    held: Callable[..., None]

    def __reduce__(self) -> Any:
        return inverse_kernel, (self.structure,)


def derivative(structure: Structure, dynamics: Dynamics = inverse_dynamics) -> Callable[..., Array]:
    """The compiled rates of a structure of any mechanism; compiles at the first use on a machine.

    derivative(state, torque, lengths, theta)
        Rates (S,) of a state (S,) under interface torques (4,), with ``theta`` (P,) in the order of
        ``structure.parameter_names`` and the mechanism's ``lengths`` in its order.
    """
    return built(structure, System(dynamics), _compiled_derivative)


def rollout(structure: Structure, dynamics: Dynamics) -> Callable[..., None]:
    """The compiled free run of the same module.

    rollout(start, torque, duration, lengths, theta, substeps, out)
        From ``start`` (S,) under ``torque`` (N, 4), linear between samples that lie ``duration``
        (N - 1,) [s] apart; fills ``out`` (N, S).
    """
    return built(structure, System(dynamics), _compiled_rollout)


def inverse_kernel(structure: Structure, dynamics: Dynamics = inverse_dynamics) -> InverseKernel:
    """The same of the platform's inverse dynamics: a module of its own, since few need it."""
    return built(structure, Inverse(dynamics), _compiled_inverse)


@lru_cache(maxsize=192)
def built(
    structure: Structure | None, system: Generated, compiled: Callable[[Any, Path], Any]
) -> Any:
    """What ``compiled(structure, path)`` makes of a structure's generated module, kept on disk.

    Without a structure the module is the same for all. A cached file that is torn or damaged is
    written again.
    """
    # The second attempt compiles what the first found damaged and removed.
    for _ in range(2):
        path = _cached_source(structure, system)
        try:
            return compiled(structure, path)
        except Exception:
            # A damaged cache (Python source, numba's pickles) can raise anything, and removing it
            # always helps. If the physics itself does not compile, the last attempt raises.
            _forget(path)
    return compiled(structure, _private_source(structure, system))


def _code(path: Path) -> tuple[int, int, int]:
    """What ``runge_kutta`` takes of a generated module."""
    module = load(path)
    known = address_of(module.known, numbers_signature(3))
    return known, address_of(module.rates, rates_signature()), module.KNOWN


def _compiled_derivative(structure: Structure, path: Path) -> Callable[..., Array]:
    """Load a generated module and call its function once, so that a damaged cache fails here."""
    code = _code(path)

    def rates(*arrays: Array) -> Array:
        given = [np.ascontiguousarray(array, float) for array in arrays]
        found = np.empty(len(given[0]))
        runge_kutta.derivative(code, *given, found)
        return found

    mechanism = structure.mechanism
    sizes = (structure.state_names, mechanism.joints, mechanism.lengths, structure.parameter_names)
    rates(*(np.ones(len(names)) for names in sizes))
    return rates


def _compiled_rollout(structure: Structure, path: Path) -> Callable[..., None]:
    run = Bound(runge_kutta.rollout, _code(path))
    size, count = len(structure.state_names), len(structure.parameter_names)
    start, torque, out = (
        np.zeros(size),
        np.zeros((2, len(structure.mechanism.joints))),
        np.empty((2, size)),
    )
    run(
        start,
        torque,
        np.zeros(1),
        np.ones(len(structure.mechanism.lengths)),
        np.ones(count),
        1,
        out,
    )
    return run


def _compiled_inverse(structure: Structure, path: Path) -> InverseKernel:
    module = load(path)
    demand = address_of(module.demand, numbers_signature(5))
    command = address_of(module.command, numbers_signature(7))
    # Without losses under load the demand does not read the torque: the first round is exact.
    rounds = inverse_loops.ROUNDS if structure.depends_on_load else 1
    found = InverseKernel(
        structure,
        Bound(inverse_loops.acting, demand, rounds),
        Bound(inverse_loops.several, demand, rounds),
        Bound(inverse_loops.interface, command),
        Bound(inverse_loops.held, demand, command, rounds),
    )
    motion, torque = np.zeros((3, len(MOTION))), np.zeros((3, 4))
    lengths = np.ones(len(structure.mechanism.lengths))
    theta = np.ones(len(structure.parameter_names))
    found.held(motion, 1.0, lengths, theta, 1.0, torque, np.empty(4), np.empty(4))
    found.acting(motion, lengths, theta, 1.0, torque)
    found.several(motion, lengths, theta[None], 1.0, torque[None])
    found.interface(torque[0], torque[0], torque[0], motion[0], lengths, theta, np.empty(4))
    return found


def _cached_source(structure: Structure | None, system: Generated) -> Path:
    folder = cache_folder()
    if folder is None:
        return _private_source(structure, system)
    path = folder / f"{system.prefix}_{_key(structure, system)}.py"
    if _is_intact(path):
        return path
    try:
        # What others wrote, or damage, must not stay: numba's pickles are loaded as they are.
        _forget(path)
        return _write(path, _sealed_source(structure, system))
    except OSError:
        return _private_source(structure, system)


def _private_source(structure: Structure | None, system: Generated) -> Path:
    """Source in a temporary folder of this process, for a cache folder that cannot be used."""
    path = private_folder() / f"{system.prefix}_{_key(structure, system)}.py"
    return _write(path, _sealed_source(structure, system))


def _sealed_source(structure: Structure | None, system: Generated) -> str:
    source = system.source(structure)
    return f"{_SEAL}{_checksum(source)}\n{source}"


_SEAL = "# sha256 of what follows: "


def _checksum(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()


def _is_intact(path: Path) -> bool:
    """Whether a generated file exists, is complete, and numba can write beside it; and nobody else
    can have written it, or what numba cached for it."""
    compiled = path.parent / "__pycache__"
    files = [path, *([compiled] if compiled.exists() else []), *compiled.glob(f"{path.stem}.*")]
    if not all(map(is_safe, files)):
        return False
    try:
        first, source = path.read_text("utf-8").split("\n", 1)
    except (OSError, ValueError):
        return False
    return first == _SEAL + _checksum(source) and os.access(path.parent, os.W_OK)


def _write(path: Path, source: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    # Replaced in one step: another process must never import half a file.
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(source)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)
    return path


def _forget(path: Path) -> None:
    """Remove a generated file with all that numba and Python cached for it."""
    # Otherwise the next import would return the damaged module.
    sys.modules.pop(_module_name(path), None)
    for stale in (path, *(path.parent / "__pycache__").glob(f"{path.stem}.*")):
        try:
            stale.unlink(missing_ok=True)
        except OSError:
            continue  # not ours to remove; the next attempt goes elsewhere or fails by itself


def _key(structure: Structure | None, system: Generated) -> str:
    """Changes with whatever could change the generated source."""
    digest = hashlib.sha256(youbot_env.__version__.encode())
    digest.update(system.variant.encode())
    for name in (*SOURCES, *system.sources):
        # The source files, not the version alone: an edit of the physics must give a new kernel.
        digest.update(Path(str(sys.modules[name].__file__)).read_bytes())
    if structure is not None:
        _digest_structure(digest, structure)
    return digest.hexdigest()[:24]


def _digest_structure(digest: Any, structure: Structure) -> None:
    """A mechanism, and what its effects compute."""
    # Several kinds may stand in one module.
    digest.update(repr((structure.mechanism.home, structure.mechanism.lengths)).encode())
    digest.update(Path(str(sys.modules[structure.mechanism.module].__file__)).read_bytes())
    for item in structure.components:
        digest.update(repr((item.name, item.acts_at.name, item.parameter_names)).encode())
        digest.update(repr([parameter.each_wheel for parameter in item.parameters]).encode())
        used = (item.function, item.carries, item.public and item.public.inverse)
        for function in (one for one in used if one):
            _digest_function(digest, function, set())


def _digest_function(digest: Any, function: Any, seen: set[int]) -> None:
    """What a function computes: its bytecode, constants, and the values and functions it uses."""
    # Functions may call each other, or themselves.
    if id(function) in seen:
        return
    seen.add(id(function))
    names = _digest_code(digest, function.__code__)
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    used = [function.__globals__[name] for name in names if name in function.__globals__]
    for value in (*cells, *(function.__defaults__ or ()), *used):
        if isinstance(value, FunctionType):
            _digest_function(digest, value, seen)
        elif isinstance(value, ModuleType):
            # The numbers that are read from a module, such as math.pi; its repr holds its path.
            shared = [getattr(value, name, None) for name in names]
            digest.update(repr([v for v in shared if isinstance(v, (int, float))]).encode())
        else:
            digest.update(repr(value).encode())


def _digest_code(digest: Any, code: CodeType) -> list[str]:
    """Digest code with what is nested in it; returns the names that it refers to."""
    # Bytecode names constants, attributes and globals by index only, so these are added.
    digest.update(code.co_code)
    names = list(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            # A nested function or lambda. Its repr would hold a memory address.
            names += _digest_code(digest, constant)
        else:
            digest.update(repr(constant).encode())
    digest.update(repr(code.co_names).encode())
    return names


def _module_name(path: Path) -> str:
    return f"_youbot_{path.stem}"


def loaded(structure: Structure | None, path: Path) -> ModuleType:
    """The generated module itself, for ``built``."""
    return load(path)


def load(path: Path) -> ModuleType:
    name = _module_name(path)
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    # Only a module that has run without an error is kept.
    sys.modules[name] = module
    return module
