"""The generated derivative: what parameters alone determine is computed once, to the same bits."""

from __future__ import annotations

import ast
import math
from typing import Any

import numpy as np
import pytest

from tests.youbot_env.structures import model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.simulation import generated_code as generated
from youbot_env.simulation.generated_code import System


def functions(source: str) -> Any:
    """A generated module's functions, not compiled."""
    scope: dict[str, Any] = {}
    exec(source, scope)
    return scope


@pytest.mark.parametrize("case", ["base", "wheel_stribeck_friction", "tether"])
def test_it_has_the_bits_of_the_formulas_as_they_stand(case: str) -> None:
    m = model(case)
    names = {
        "state": [f"s{i}" for i in range(len(m.structure.state_names))],
        "torque": ["u1", "u2", "u3", "u4"],
        "lengths": [f"g_{name}" for name in m.structure.mechanism.lengths],
        "theta": [f"p{i}" for i in range(len(m.theta))],
    }
    rng = np.random.default_rng(1)
    state, slope, torque = rng.normal(size=(3, len(names["state"]))).tolist()
    values = dict(zip(names["lengths"], m.lengths, strict=True))
    values |= dict(zip(names["theta"], m.theta.tolist(), strict=True))
    values |= {n: s + 0.5 * d for n, s, d in zip(names["state"], state, slope, strict=True)}
    values |= dict(zip(names["torque"], torque[:4], strict=True))
    formulas = generated.derivative_formulas(m.structure, dynamics, names)
    scope = {**vars(math), **values}
    shared, results = generated._printed(formulas)
    for name, code in shared:
        scope[name] = eval(code, scope)
    expected = [eval(code, scope) for code in results]

    code = functions(System(dynamics).source(m.structure))
    known, found = [math.nan] * code["KNOWN"], [math.nan] * len(state)
    code["known"].py_func(m.lengths, m.theta.tolist(), known)
    code["rates"].py_func(state, 0.5, slope, torque, known, found)
    assert found == expected


def test_nothing_of_parameters_alone_is_left_in_the_derivative() -> None:
    source = System(dynamics).source(model("wheel_stribeck_friction").structure)
    rates = next(f for f in ast.parse(source).body if getattr(f, "name", "") == "rates")
    fixed = {
        statement.targets[0].id
        for statement in ast.walk(rates)
        if isinstance(statement, ast.Assign)
        and isinstance(statement.targets[0], ast.Name)
        and ast.unparse(statement.value).startswith("known[")
    }
    assert fixed
    for node in ast.walk(rates):
        if isinstance(node, (ast.BinOp, ast.Call)) and "[" not in ast.unparse(node):
            read = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
            assert not read <= fixed or not read & fixed, ast.unparse(node)
