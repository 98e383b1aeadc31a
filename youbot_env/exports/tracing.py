"""The state's derivative as a short list of torch operations, traced from the dynamics.

Evaluated as it is written, the definition asks for the same wrench at several accelerations and so
repeats itself; the trace says each thing once. It is flat, so that torch.compile takes it too.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import torch.fx
from torch.fx.proxy import GraphAppendingTracer

from youbot_env import dynamics
from youbot_env.backends import floats, tensors
from youbot_env.structure import Structure

XP = tensors()
"""What the traced operations call. One for all traces, so that torch.compile knows it again."""


def traced_derivative(structure: Structure, geometry: Any) -> Callable[..., tuple[Any, ...]]:
    """``dynamics.state_derivative`` as a function of S + 4 + P tensors: state, torque, theta.

    It returns S components, tensors or plain numbers. Any shapes that broadcast will do, and any
    floating-point type or device: nothing of them is in the trace.
    """
    graph = torch.fx.Graph()
    tracer = FoldingTracer(graph)

    def inputs(name: str, count: int) -> list[Any]:
        return [
            torch.fx.Proxy(graph.placeholder(f"{name}{index}"), tracer) for index in range(count)
        ]

    state = inputs("x", len(structure.state_names))
    torque = inputs("u", 4)
    theta = inputs("p", len(structure.parameter_names))
    rates = dynamics.state_derivative(
        namespace(tracer, state[0]), structure, geometry, theta, tuple(state), tuple(torque)
    )
    graph.output(tuple(rate.node if _is_traced(rate) else rate for rate in rates))
    graph.eliminate_dead_code()
    # The method alone: as a module of its own it would show among a model's.
    return torch.fx.GraphModule(torch.nn.Module(), graph).forward


class FoldingTracer(GraphAppendingTracer):
    """Writes operations into a graph, but none twice, and none with a 0 or 1 that decides it."""

    def __init__(self, graph: torch.fx.Graph) -> None:
        super().__init__(graph)
        self._known: dict[Any, Any] = {}

    def create_proxy(self, kind: str, target: Any, args: Any, kwargs: Any, *rest: Any, **more: Any):
        """The operation's result: a new node, an earlier one, or a plain number."""
        if target in FOLDS and (found := FOLDS[target](*args)) is not None:
            return found
        key = (target, *(a.node if _is_traced(a) else (type(a), a) for a in args))
        if key not in self._known:
            self._known[key] = super().create_proxy(kind, target, args, kwargs, *rest, **more)
        return self._known[key]


def namespace(tracer: FoldingTracer, like: Any) -> Any:
    """What effects compute with while they are traced: calls of the tensors' namespace.

    ``like`` is an input whose floating-point type a choice between plain numbers takes.
    """

    def lift(name: str) -> Any:
        def call(*arguments: Any) -> Any:
            if not any(_is_traced(value) for value in arguments):
                return getattr(floats, name)(*arguments)
            if name == "where":
                return tracer.create_proxy("call_function", where_like, (*arguments, like), {})
            return tracer.create_proxy("call_function", getattr(XP, name), arguments, {})

        return call

    return SimpleNamespace(**{name: lift(name) for name in vars(floats)})


def where_like(condition: Any, yes: Any, no: Any, like: torch.Tensor) -> Any:
    """``where`` whose plain numbers become tensors of the type of ``like``.

    In torch's default type, single, they would round what they are multiplied with.
    """

    def lifted(value: Any) -> torch.Tensor:
        is_tensor = isinstance(value, torch.Tensor)
        return value if is_tensor else torch.as_tensor(value, dtype=like.dtype, device=like.device)

    return torch.where(condition, lifted(yes), lifted(no))


def _is_traced(value: Any) -> bool:
    return isinstance(value, torch.fx.Proxy)


def _is(value: Any, number: float) -> bool:
    return not _is_traced(value) and value == number


def _sum(a: Any, b: Any) -> Any:
    return b if _is(a, 0.0) else a if _is(b, 0.0) else None


def _difference(a: Any, b: Any) -> Any:
    return a if _is(b, 0.0) else -b if _is(a, 0.0) else None


def _product(a: Any, b: Any) -> Any:
    for one, other in ((a, b), (b, a)):
        if _is(one, 0.0):
            return 0.0
        if _is(one, 1.0):
            return other
        if _is(one, -1.0):
            return -other
    return None


def _quotient(a: Any, b: Any) -> Any:
    return 0.0 if _is(a, 0.0) else a if _is(b, 1.0) else None


FOLDS: dict[Callable[..., Any], Callable[[Any, Any], Any]] = {
    operator.add: _sum,
    operator.sub: _difference,
    operator.mul: _product,
    operator.truediv: _quotient,
}
"""What a sum, difference, product or quotient is without being computed; None if it must be."""
