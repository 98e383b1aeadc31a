"""What the engine asks of a mechanism: all that it ever knows of the robot at hand.

Residuals, columns, fits, free runs, candidates and reports work on whatever derives from
:class:`Mechanism`. N samples, P parameters, F of them free, A axes, k joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from identification.logs.log import Log
from youbot_env.physics.effect import Parameter, Registry
from youbot_env.physics.structure import Composition

Array = NDArray[np.float64]


class ParameterLabel(NamedTuple):
    """A parameter's component, name and declaration; group: those it is relative to, if any."""

    component: str
    name: str
    parameter: Parameter
    group: str | None


def labels_of(structure: Composition) -> tuple[ParameterLabel, ...]:
    """What is known of each parameter of a structure beforehand, in the order of theta."""
    found = []
    for item in structure.components:
        for name in item.parameter_names:
            parameter = item.parameter(name)
            group = f"{item.name}.{parameter.name}" if parameter.relative_to else None
            found.append(ParameterLabel(item.name, name, parameter, group))
    return tuple(found)


class FitResult(Protocol):
    """What a model is made of: theta (P,), the fitted ones' indices (F,), covariance and std."""

    @property
    def theta(self) -> Array: ...
    @property
    def free(self) -> NDArray[np.intp]: ...
    @property
    def covariance(self) -> Array: ...
    @property
    def std(self) -> Array: ...


class Samples(Protocol):
    """One log on a uniform time base: its name, time (N,) [s] from the log's start, and dt [s].

    channels: speeds and efforts (N, k) of the joints, as logged.
    """

    @property
    def name(self) -> str: ...
    @property
    def time(self) -> Array: ...
    @property
    def dt(self) -> float: ...
    @property
    def channels(self) -> tuple[Array, Array]: ...
    def __len__(self) -> int: ...


class Experiment(NamedTuple):
    """A motion that could be recorded.

    name, content : of the motion, as its file holds it
    samples(theta) : what a log of it would hold at parameters theta (P,), without noise
    """

    name: str
    content: Mapping[str, Any]
    samples: Callable[[Array], Samples]


class DemandedForce(Protocol):
    """Force that a logged motion demands."""

    @property
    def force(self) -> Array:
        """(2, N - 1, A) at the start and at the end of each interval."""
        ...

    def columns(self, indices: Iterable[int], /) -> Array:
        """d force / d theta[i] for each index: (len(indices), 2, N - 1, A)."""
        ...


class Mechanism(Protocol):
    """A mechanism with given effects: what it measures, demands and simulates.

    axes : names of the axes of force and speed; joints : names of the joints in its logs
    catalogue : the effects that it can have
    filter_rate : of the filter through which forces are fitted [rad/s]
    scaling : how ``scale`` scales the parameters, in words
    structure : which effects it holds (``effects``), and what is known of them (``nonlinear``:
        in whose own parameters the force is not linear)
    """

    structure: Any
    axes: tuple[str, ...]
    joints: tuple[str, ...]
    catalogue: Registry
    filter_rate: float
    scaling: str

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of theta."""
        return self.structure.parameter_names

    @property
    def labels(self) -> tuple[ParameterLabel, ...]:
        """(P,) what is known of each parameter beforehand."""
        ...

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(P,) whether a parameter is identified linearly (shape constants stay as they are)."""
        return np.array([not label.parameter.is_shape for label in self.labels])

    @property
    def order(self) -> NDArray[np.intp]:
        """(F,) indices of the free parameters, in the order in which they are shown."""
        ...

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) and (P,): physical bounds."""
        ...

    @property
    def scale(self) -> Array:
        """(P,) factors from theta to numbers of one size."""
        ...

    @property
    def is_linear(self) -> bool:
        """Whether the demanded force is linear in the free parameters."""
        ...

    def with_effects(self, effects: tuple[str, ...]) -> Self:
        """The same mechanism with other effects beside the base model."""
        ...

    def extended(self, name: str) -> Self:
        """The same mechanism with one effect more."""
        return self.with_effects((*self.structure.effects, name))

    def extend_theta(self, theta: Array, name: str, shapes: Mapping[str, float]) -> Array:
        """theta (P,) followed by those of effect ``name``: no strength, shapes as given."""
        effect = self.catalogue[name]
        values = {**effect.defaults, **shapes}
        return np.concatenate([theta, [values[key] for key in effect.parameter_names]])

    def samples(self, log: Log, /) -> Any:
        """Motion and effort of a log."""
        ...

    def parts(self, samples: Any, /) -> list[Any]:
        """Stretches of a log (`segments.Part`) that are judged apart."""
        ...

    def noisy(self, samples: Any, speed: Array, effort: Array, rng: np.random.Generator, /) -> Any:
        """The samples with white noise of these standard deviations (k,) put on."""
        ...

    def measured_force(self, samples: Any, /) -> Array:
        """(N, A) generalised force of the logged efforts."""
        ...

    def measured_speed(self, samples: Any, /) -> Array:
        """(N, A) measured speed."""
        ...

    def demand(self, theta: Array, samples: Any, /, like: Any = None) -> DemandedForce:
        """Force that the logged motion demands at parameters theta.

        ``like``: the demand of the same samples at a structure that this one extends by what has
        no strength at theta; it may take over what that one has found out.
        """
        ...

    def motions(self, seed: int, /) -> Sequence[Experiment]:
        """Motions that could be recorded next, for a diagnosis to choose from; () if none is known.

        ``seed``: of those that are random.
        """
        return ()

    def free_run(self, theta: Array, samples: Any, /) -> Array:
        """(N, A) speed from the log's first sample, driven by its efforts alone."""
        ...

    def joint_speed(self, speed: Array, /) -> Array:
        """(N, k) speeds of the log's joints at a speed (N, A)."""
        ...

    def advice(self, direction: Array, /) -> str:
        """What to record where the free parameters' ``direction`` (F,) cannot be seen."""
        ...
