"""Printed equations: they say what the simulation computes, and prove what a fit assumes."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pytest
import sympy
from sympy.parsing.sympy_parser import (
    implicit_multiplication,
    parse_expr,
    standard_transformations,
)

from tests.sparing import mostly_slow
from tests.youbot_env.structures import CASES, EFFECTS, model, random_instant
from youbot_env.equations.equations import SIDES, Equations, equation, formula
from youbot_env.equations.printing import collected, join, text, tidy
from youbot_env.errors import InputError
from youbot_env.model.model import Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import BASE, CATALOGUE
from youbot_env.physics.geometry import roller_rates, wheel_rates
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.physics.mechanism import Instant, ModelStructure

AS_IN_THE_PAPER = """\
(m0 + 4 I1/R^2) VX' - m aY W' - m0 VY W - m aX W^2 + (4 mu1/R^2) VX = F_X
(m0 + 4 I1/R^2) VY' + m aX W' + m0 VX W - m aY W^2 + (4 mu1/R^2 + 8 mu2/r^2) VY = F_Y
(I0 + 4 I1 L^2/R^2) W' - m aY VX' + m aX VY' + m aX VX W + m aY VY W \
+ (4 L^2 mu1/R^2 + 8 h^2 mu2/r^2) W = M_W
F_X = (M1 + M2 + M3 + M4)/R
F_Y = (M2 + M3 - M1 - M4)/R
M_W = L (M2 + M4 - M1 - M3)/R"""


def test_the_base_model_prints_as_the_paper_writes_it():
    assert equation(mecanum_structure()) == AS_IN_THE_PAPER


def parsed(line: str) -> sympy.Expr:
    """A printed side as an expression again, with ' spelled _dot."""
    plain = re.sub(r"\|([^|]+)\|", r"Abs(\1)", line.replace("^", "**"))
    plain = plain.replace("''", "_ddot").replace("'", "_dot")
    plain = re.sub(r"\[(\w+) >= ([\w.]+)\]", r"Heaviside(\1 - \2, 1)", plain)
    functions = {"tanh", "sin", "cos", "exp", "Abs", "sqrt", "Heaviside", "Max"}
    words = set(re.findall(r"[A-Za-z_]\w*", plain)) - functions
    rules = (*standard_transformations, implicit_multiplication)
    return parse_expr(plain, {w: sympy.Symbol(w) for w in words}, rules)


def numbers(m: Model, at: Instant) -> dict[str, float]:
    """Values for every name that a printed equation can hold."""
    g = m.geometry
    rolling = dynamics.rolling_geometry(np, m.structure, g, m.theta)
    mass = m.values["m0"] - 4 * g.m1
    found = {"m": mass, "aX": m.values["aX"], "aY": m.values["aY"], "t": at.time, "t0": at.start}
    found["pi"] = np.pi
    found |= {"h": g.h, "R": g.R, "r": g.r, "L": g.L}
    symbols = [str(symbol) for symbol in Equations(m.structure).theta]
    found |= dict(zip(symbols, m.theta, strict=True))
    found |= dict(zip(("VX", "VY", "W"), at.twist, strict=True))
    found |= dict(zip(("VX_dot", "VY_dot", "W_dot"), at.acceleration, strict=True))
    found |= dict(zip(("x", "y", "psi"), at.pose, strict=True))
    rows = {
        "phi{}": at.wheel_angle,
        "phi{}_dot": wheel_rates(rolling, at.twist),
        "phi{}_ddot": wheel_rates(rolling, at.acceleration),
        "M{}": at.torque,
        "gamma{}_dot": roller_rates(rolling, at.twist),
        "gamma{}_ddot": roller_rates(rolling, at.acceleration),
    }
    for name, values in rows.items():
        found |= {name.format(i + 1): value for i, value in enumerate(values)}
    return found


def evaluated(line: str, known: dict[str, float]) -> float:
    expression = parsed(line)
    names = {symbol: str(symbol) for symbol in expression.free_symbols}
    missing = set(names.values()) - set(known)
    assert not missing, f"the printed equation speaks of {missing}"
    return float(expression.subs({symbol: known[name] for symbol, name in names.items()}))


@pytest.mark.parametrize("case", CASES)
def test_what_is_printed_evaluates_to_the_wrench(case: str):
    """The very text, read back and evaluated on numbers."""
    m, at = model(case), random_instant(np.random.default_rng(0))
    wrench = dynamics.wrench(np, m.structure, m.geometry, m.theta, at)
    known = numbers(m, at)
    lines = equation(m).splitlines()
    for line, side, expected in zip(lines[:3], SIDES, wrench, strict=True):
        left, right = line.split(" = ")
        assert right == side
        assert evaluated(left, known) == pytest.approx(expected, rel=1e-11)
    force = dict(zip(SIDES, np.array(at.torque) @ m.joint_jacobian, strict=True))
    for line in lines[3:]:
        left, right = line.split(" = ")
        if left in force:
            assert evaluated(right, known) == pytest.approx(force[left], rel=1e-11)
        elif left.startswith(("phi", "gamma")):
            name = left.replace("''", "_ddot").replace("'", "_dot")
            assert evaluated(right, known) == pytest.approx(known[name], rel=1e-11)
        elif left in known:  # a parameter in the form in which a model holds it
            stated = {name.split(".")[-1]: value for name, value in m.values.items()}
            stated |= {"_".join(name.split(".")[::-1]): value for name, value in m.values.items()}
            assert evaluated(right, stated) == pytest.approx(known[left], rel=1e-11)
        else:
            assert left in ("M_command", "M_true", "T_late", "w_true")


@pytest.mark.parametrize("case", mostly_slow(CASES, set(CASES) - {"everything"}))
def test_numbers_in_print_are_the_models(case: str):
    m, at = model(case), random_instant(np.random.default_rng(1))
    wrench = dynamics.wrench(np, m.structure, m.geometry, m.theta, at)
    known = {
        n: v
        for n, v in numbers(m, at).items()
        if re.match(r"VX|VY|W|phi|gamma|M\d|[xyt]$|psi|pi$", n)
    }
    scale = np.abs(wrench).max()
    for line, expected in zip(equation(m, "numeric").splitlines(), wrench, strict=False):
        assert evaluated(line.split(" = ")[0], known) == pytest.approx(expected, abs=1e-4 * scale)


@pytest.mark.parametrize("case", CASES)
def test_latex_is_balanced_and_names_nothing_in_plain_text(case: str):
    for line in equation(model(case), "latex").splitlines():
        assert line.count("{") == line.count("}")
        assert line.count(r"\left") == line.count(r"\right")
        assert "phi1" not in line and "'" not in line and "**" not in line


def test_latex_of_the_base_model():
    first = equation(mecanum_structure(), "latex").splitlines()[0]
    assert first.replace(r" \, ", " ") == (
        r"\left(m_{0} + \frac{4 I_{1}}{R^{2}}\right) \dot{V}_{X} - m a_{Y} \dot{W} "
        r"- m_{0} V_{Y} W - m a_{X} W^{2} + \frac{4 \mu_{1}}{R^{2}} V_{X} = F_{X}"
    )
    assert first.count(r" \, ") == 10


def test_a_name_of_letters_is_parted_from_a_function_and_has_its_words_as_an_index():
    shown = formula(CATALOGUE["wheel_stribeck_friction"], "latex")
    assert r"\mathrm{torque} \, \tanh" in shown and r"\mathrm{stribeck}_{\mathrm{speed}}" in shown
    assert r"\_" not in "".join(formula(item, "latex") for item in CATALOGUE)


def test_what_cannot_be_printed_is_refused():
    with pytest.raises(InputError, match="choose text, latex or numeric"):
        equation(mecanum_structure(), "html")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="numbers need a model"):
        equation(mecanum_structure(), "numeric")


# --- linearity -------------------------------------------------------------------------------


def linear_symbols(structure: ModelStructure) -> list[sympy.Symbol]:
    """Symbols of the parameters that are identified linearly."""
    theta = Equations(structure).theta
    return [
        theta[where.start + k]
        for item, where in structure.slices
        if item.acts_at.kind == "wrench"
        for k, name in enumerate(item.parameter_names)
        if not item.parameter(name).is_shape
    ]


def curvature(side: sympy.Expr, symbols: Sequence[sympy.Expr]) -> sympy.Matrix:
    return sympy.hessian(side, symbols).applyfunc(sympy.simplify)


LINEAR = [c for c in CASES if not model(c).structure.base_readers | model(c).structure.nonlinear]


@pytest.mark.parametrize("case", LINEAR)
def test_the_wrench_is_proven_linear_in_its_parameters(case: str):
    """No second derivative, and nothing left at zero: Y theta is the whole wrench."""
    structure = model(case).structure
    symbols = linear_symbols(structure)
    for side in Equations(structure).sides:
        assert curvature(side, symbols).is_zero_matrix
        assert side.subs(dict.fromkeys(symbols, 0)) == 0


@pytest.mark.parametrize("case", [c for c in CASES if model(c).structure.base_readers])
def test_effects_that_multiply_base_parameters_are_proven_linear_in_the_base(case: str):
    structure = model(case).structure
    base = Equations(structure).theta[:7]
    for side in Equations(structure).sides:
        assert curvature(side, base).is_zero_matrix


def test_a_wrench_that_is_not_linear_would_be_seen():
    symbols = Equations(mecanum_structure(("floor_tilt",))).theta
    assert not curvature(
        Equations(mecanum_structure(("floor_tilt",))).sides[0], symbols
    ).is_zero_matrix


# --- formulas --------------------------------------------------------------------------------


@pytest.mark.parametrize("item", [*BASE, *CATALOGUE], ids=lambda e: e.name)
def test_each_effect_has_a_formula_of_one_line(item):
    for form in ("text", "latex"):
        printed = formula(item, form)
        assert "\n" not in printed and " = " in printed
    for parameter in item.parameters if item.name in BASE else item.public_parameters:
        assert parameter.name.replace("_a", " a") in formula(item) or parameter.name in formula(
            item
        )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("wheel_coulomb_friction", "dM = torque tanh(phi'/smoothing)"),
        ("load_dependent_friction", "dM = share tanh(phi'/smoothing) |M|"),
        ("actuator_lag", "M_command = M + time_constant M'"),
        ("torque_gain_error", "M_true = (1 + gain) M"),
    ],
)
def test_formulas_read_as_a_person_would_write_them(name: str, expected: str):
    assert formula(CATALOGUE[name]) == expected


def test_every_effect_of_the_registry_was_seen():
    assert set(EFFECTS) == set(CATALOGUE.names()) and len(CASES) == len(EFFECTS) + 2


@pytest.mark.parametrize("zero", [0, 0.0, sympy.Integer(0), sympy.Float(0.0)])
def test_a_component_without_force_prints_as_zero(zero):
    assert collected(zero, set()) == []
    assert join([], text) == "0"


def test_tidy_names_what_rounding_hid_and_leaves_the_rest():
    x = sympy.Symbol("x")
    hidden = 2.0000000000000004 * x + sympy.tanh(-1.4142135623730951 * x) + 9.80665
    shown = tidy(hidden)
    assert shown == 2 * x - sympy.tanh(sympy.sqrt(2) * x) + sympy.Float(9.80665)
