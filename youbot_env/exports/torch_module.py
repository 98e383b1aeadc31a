"""The model as a torch module with gradients. Imports torch: take ``youbot_env.to_torch``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial, reduce
from types import SimpleNamespace
from typing import Any

import sympy
import torch
from sympy.printing.pycode import PythonCodePrinter
from torch import Tensor, nn

from youbot_env.errors import InputError
from youbot_env.exports.step_function import refuse_delay
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import CLOCK
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mechanism import Instant, ModelStructure
from youbot_env.physics.namespaces import symbols, tensors
from youbot_env.physics.stated_parameters import internal_values
from youbot_env.simulation import free_run as simulate
from youbot_env.simulation.generated_code import real_symbols
from youbot_env.simulation.plant import plant_substeps

XP = tensors()
"""Functions of tensors. One object for all modules, so that torch.compile does not compile anew for
each."""


def torch_derivative(structure: ModelStructure, geometry: Geometry) -> Callable[..., list[Any]]:
    """``dynamics.state_derivative`` as a function of S + 4 + P tensors: state, torque, theta.

    It returns S components, tensors or plain numbers. Arguments may have any shapes that broadcast,
    and any floating-point type or device. Sympy writes the function: it shares what occurs twice
    and drops terms times zero. It takes a fifth less time than the effects on tensors, and
    agrees to 2e-15.
    """
    names = structure.mechanism.lengths
    lengths = [getattr(geometry, name) for name in names]
    symbol = {
        "lengths": real_symbols([f"g_{name}" for name in names]),
        "state": real_symbols([f"s{i}" for i in range(len(structure.state_names))]),
        "torque": real_symbols([f"u{i}" for i in range(4)]),
        "theta": real_symbols([f"p{i}" for i in range(len(structure.parameter_names))]),
    }
    rates = dynamics.state_derivative(
        symbols(),
        structure,
        SimpleNamespace(**dict(zip(names, symbol["lengths"], strict=True))),
        symbol["theta"],
        tuple(symbol["state"]),
        tuple(symbol["torque"]),
    )
    function = sympy.lambdify(
        [name for group in symbol.values() for name in group],
        [_whole_numbers(sympy.sympify(rate)) for rate in rates],
        modules=[{**vars(XP), "where": where_like}],
        printer=_TorchPrinter({"fully_qualified_modules": False}),
        cse=True,
    )
    # The lengths stay arguments: sympy prints the digits of a number only to its fifteenth.
    return partial(function, *lengths)


def _whole_numbers(expression: Any) -> Any:
    """1.0 as 1: sympy drops a factor of one only where it is an integer."""
    floats = expression.atoms(sympy.Float)
    whole = {n: sympy.Integer(int(n)) for n in floats if float(n).is_integer()}
    return expression.xreplace(whole)


class _TorchPrinter(PythonCodePrinter):
    """Prints choices as calls of ``where``: a tensor holds many values, and ``if`` takes one."""

    def _print_Piecewise(self, expr: Any) -> str:
        *choices, (last, _) = expr.args
        code = self._print(last)
        for value, condition in reversed(choices):
            # s0, the first state, is always a tensor: it gives the type of plain numbers.
            code = f"where({self._print(condition)}, {self._print(value)}, {code}, s0)"
        return code

    def _print_Max(self, expr: Any) -> str:
        return reduce(lambda a, b: f"maximum({a}, {b})", map(self._print, expr.args))

    def _print_Min(self, expr: Any) -> str:
        return reduce(lambda a, b: f"minimum({a}, {b})", map(self._print, expr.args))

    def _print_And(self, expr: Any) -> str:
        return " & ".join(f"({self._print(part)})" for part in expr.args)

    def _print_Or(self, expr: Any) -> str:
        return " | ".join(f"({self._print(part)})" for part in expr.args)

    def _print_Not(self, expr: Any) -> str:
        return f"~({self._print(expr.args[0])})"

    def _print_sign(self, expr: Any) -> str:
        return f"sign({self._print(expr.args[0])})"


def where_like(condition: Any, yes: Any, no: Any, like: torch.Tensor) -> Any:
    """``where`` whose plain numbers become tensors of the type of ``like``.

    In torch's default type, single, they would round what they are multiplied with.
    """
    if not isinstance(condition, torch.Tensor):
        return yes if condition else no

    def lifted(value: Any) -> torch.Tensor:
        is_tensor = isinstance(value, torch.Tensor)
        return value if is_tensor else torch.as_tensor(value, dtype=like.dtype, device=like.device)

    return torch.where(condition, lifted(yes), lifted(no))


class TorchPlatform(nn.Module):
    """A model whose parameters are the platform's physical ones, as people state them.

    ``platform.named_parameters()`` has the full names of ``model.values``: ``m0`` ... ``mu2``, then
    ``effect.parameter``, each a number in SI units. States are in the order of
    ``model.structure.state_names``, leading axes broadcast. Everything works under ``torch.func``
    (``functional_call`` with other parameters, ``jacrev``, ``vmap``) and ``torch.compile``.

    Parameters
    ----------
    model : what it starts from
    trainable : full names of the parameters that require gradients; None is all
    dtype, device : of the parameters; single precision keeps about six digits of a twist

    Raises
    ------
    InputError
        If a name is unknown.
    """

    def __init__(
        self,
        model: Model,
        *,
        trainable: Iterable[str] | None = None,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__()
        chosen = set(model.values if trainable is None else trainable)
        if unknown := sorted(chosen - set(model.values)):
            raise InputError(
                f"trainable: no parameter {unknown[0]!r}; it has {', '.join(model.values)}"
            )
        self.model = model
        self._rates = torch_derivative(model.structure, model.geometry)
        self._has_clock = bool(model.structure.at(CLOCK))
        # A delay of 0 that may be trained needs its gradient, which a single step cannot give.
        self._late_step = any(name in chosen for name in _clock_parameters(model))
        for effect in model.effects:
            self._name_is_free(self, effect)
            self.add_module(effect, nn.Module())
        for name, value in model.values.items():
            number = torch.tensor(value, dtype=dtype, device=device)
            effect, _, key = name.rpartition(".")
            owner = self.get_submodule(effect)
            self._name_is_free(owner, key)
            owner.register_parameter(key, nn.Parameter(number, requires_grad=name in chosen))

    def _name_is_free(self, owner: nn.Module, name: str) -> None:
        if hasattr(owner, name):
            raise InputError(
                f"model {self.model.name}: {name!r} is an attribute of torch modules; "
                "rename the effect or parameter"
            )

    def values(self) -> dict[str, Tensor]:
        """The parameters by full name, in the order of ``model.values``."""
        parameters = dict(self.named_parameters())
        return {name: parameters[name] for name in self.model.values}

    def theta(self) -> list[Tensor]:
        """The parameters as the effects' functions take them (``structure.parameter_names``)."""
        return internal_values(XP, self.model.structure, self.model.geometry, self.values())

    def forward(self, state: Tensor, torque: Tensor) -> Tensor:
        """Time derivative (..., S) of the state (..., S) under torques (..., 4) [N m].

        ``torque`` is what the interface commands or logs (``model.delay`` earlier, with a delay).
        """
        return self._derivative(self.theta(), *self._checked(state, torque))

    def wrench(self, twist: Tensor, acceleration: Tensor, **at: Tensor) -> Tensor:
        """Generalised force (..., 3) [N, N, N m] that a motion demands: ``Model.wrench``.

        Linear in most parameters, and so what to fit where accelerations are known.
        """
        parts = {key: v if key == "time" else v.unbind(-1) for key, v in at.items()}
        instant = Instant(twist.unbind(-1), acceleration.unbind(-1), **parts)  # type: ignore[arg-type]
        where = (self.model.structure, self.model.geometry, self.theta())
        return _stacked(dynamics.wrench(XP, *where, instant), twist)

    def step(
        self, state: Tensor, torque: Tensor, duration: float, *, substeps: int | None = None
    ) -> Tensor:
        """State (..., S) ``duration`` [s] later under torques (..., 4) [N m], held: ``Plant.step``.

        Parameters
        ----------
        substeps : Runge-Kutta steps; None takes as many as ``Plant`` does for the model that the
            module was made from

        Raises
        ------
        InputError
            If the model has a delay: a state does not hold what is on its way. ``rollout`` does.
        """
        if self._late_step or self.model.delay != 0.0:
            refuse_delay(self.model, "a single step", "rollout")
            raise InputError("a single step cannot learn a delay; use rollout")
        count = substeps or plant_substeps(self.model, duration)
        state, torque = self._checked(state, torque)
        # Runge-Kutta reads the torque at the ends and in the middle of each step: 2 n + 1 instants.
        return self._moved(self.theta(), state, (torque,) * (2 * count + 1), duration / count)

    def rollout(
        self, state: Tensor, torque: Tensor, duration: float, *, substeps: int | None = None
    ) -> Tensor:
        """Free run: states (..., N, S) at N instants that are ``duration`` [s] apart.

        As ``simulate`` does with a log: torques (..., N, 4) [N m] are linear between the instants,
        and act later by the model's delay, which has a gradient too; before, the first one acts.

        Parameters
        ----------
        state : (..., S) at the first instant
        substeps : Runge-Kutta steps between two instants; None takes as many as the model that
            the module was made from needs
        """
        count = substeps or simulate.substeps(self.model, duration)
        state, torque = self._checked(state, torque, sampled=True)
        theta = self.theta()
        acting = self._acting(theta, torque, duration, 2 * count)
        states = [state]
        for k in range(torque.shape[-2] - 1):
            held = acting[2 * count * k : 2 * count * (k + 1) + 1]
            states.append(self._moved(theta, states[-1], held, duration / count))
        return torch.stack(torch.broadcast_tensors(*states), dim=-2)

    def to_model(self) -> Model:
        """The model at the present parameters, without the old fit's uncertainty and errors.

        Raises
        ------
        InputError
            If an optimiser has led a parameter out of its bounds.
        """
        values = {name: value.item() for name, value in self.values().items()}
        changed = {name: v for name, v in values.items() if v != self.model.values[name]}
        if not changed:
            return self.model
        source = {"source": f"parameters of a torch module, {', '.join(changed)} changed"}
        found = self.model.with_values(changed)
        return replace(found, logs=(), errors={}, provenance=source)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_rates": None}  # generated code; made again when unpickled

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._rates = torch_derivative(self.model.structure, self.model.geometry)

    def _checked(
        self, state: Tensor, torque: Tensor, *, sampled: bool = False
    ) -> tuple[Tensor, Tensor]:
        size = len(self.model.structure.state_names)
        axes = "(..., N, 4)" if sampled else "(..., 4)"
        if state.shape[-1:] != (size,) or torque.shape[-1:] != (4,) or torque.ndim <= sampled:
            raise InputError(
                f"torch platform: needs states (..., {size}) and torques {axes}, "
                f"not {tuple(state.shape)} and {tuple(torque.shape)}"
            )
        return state, torque

    def _derivative(self, theta: list[Tensor], state: Tensor, torque: Tensor) -> Tensor:
        rates = self._rates(*state.unbind(-1), *torque.unbind(-1), *theta)
        return _stacked(rates, state)

    def _moved(
        self, theta: list[Tensor], state: Tensor, torque: tuple[Tensor, ...], dt: float
    ) -> Tensor:
        """Classical Runge-Kutta steps of ``dt`` [s]; ``torque`` at the ends and middle of each."""
        for k in range(0, len(torque) - 1, 2):
            start, middle, end = torque[k : k + 3]
            a = self._derivative(theta, state, start)
            b = self._derivative(theta, state + 0.5 * dt * a, middle)
            c = self._derivative(theta, state + 0.5 * dt * b, middle)
            d = self._derivative(theta, state + dt * c, end)
            state = state + dt / 6.0 * (a + 2.0 * (b + c) + d)
        return state

    def _acting(
        self, theta: list[Tensor], torque: Tensor, duration: float, pieces: int
    ) -> tuple[Tensor, ...]:
        """Interface torques (..., 4) that act at the instants and ``pieces`` - 1 times between."""
        samples = torque.shape[-2]
        last = samples - 1
        at = torch.arange(last * pieces + 1, dtype=torque.dtype, device=torque.device) / pieces
        if self._has_clock:
            delay = dynamics.torque_delay(XP, self.model.structure, theta)
            at = (at - delay / duration).clamp(0.0, float(last))
        # The index has no gradient; the share has, and through it the delay.
        before = at.detach().floor().clamp(0, max(last - 1, 0)).long()
        share = (at - before)[:, None]
        after = (before + 1).clamp(max=last)
        mixed = torque[..., before, :] * (1.0 - share) + torque[..., after, :] * share
        return mixed.unbind(-2)


def _clock_parameters(model: Model) -> list[str]:
    return [
        f"{item.name}.{name}" for item, _ in model.structure.at(CLOCK) for name in item.public_names
    ]


def _stacked(components: Iterable[Any], like: Tensor) -> Tensor:
    """Components, plain numbers among them, as one tensor's last axis."""
    lifted = (
        c if isinstance(c, Tensor) else torch.as_tensor(c, dtype=like.dtype, device=like.device)
        for c in components
    )
    return torch.stack(torch.broadcast_tensors(*lifted), dim=-1)
