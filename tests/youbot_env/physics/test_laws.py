"""Laws that hold for every effect of the catalogue, alone and together, at catalogue size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tests.youbot_env.structures import (
    CASES,
    EFFECTS,
    catalogue_values,
    internal_values,
    model,
    random_instant,
    state_of,
)
from youbot_env.errors import InputError
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.effect import BASE, CATALOGUE, Channel
from youbot_env.physics.geometry import (
    SIGN_LATERAL,
    Geometry,
    allocate,
    body_force,
    roller_rates,
    wheel_rates,
)
from youbot_env.physics.mecanum import MECANUM, mecanum_structure
from youbot_env.physics.mechanism import EffectPoints, Instant, ModelStructure, component_force
from youbot_env.physics.namespaces import floats

SEEDS = range(20)


@pytest.mark.parametrize("case", CASES)
def test_forward_after_inverse_is_the_identity(case: str):
    m = model(case)
    where = (m.structure, m.geometry, [float(v) for v in m.theta])
    for seed in SEEDS:
        at = random_instant(np.random.default_rng(seed))
        if m.structure.has_nonlinear_channel:
            at = gently(at)
        at = replace(at, torque=dynamics.acting_torque(floats, *where, at))
        interface = dynamics.inverse_dynamics(floats, *where, at)
        rates = dynamics.state_derivative(floats, *where, state_of(m.structure, at), interface)
        np.testing.assert_allclose(rates[:3], at.acceleration, rtol=1e-12, atol=1e-12)
        if m.structure.has_actuator:
            drives = rates[11 : 11 + 4 * m.structure.drive_order]
            expected = [*at.torque_rate, *at.torque_second_rate][: len(drives)]
            np.testing.assert_allclose(drives, expected, rtol=1e-11, atol=1e-11)


def gently(at: Instant) -> Instant:
    """The motion so slow that no drive comes to its limit."""

    def part(values: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(0.02 * value for value in values)

    return replace(
        at,
        twist=part(at.twist),
        acceleration=part(at.acceleration),
        torque_rate=part(at.torque_rate),
        torque_second_rate=part(at.torque_second_rate),
    )


@pytest.mark.parametrize("case", CASES)
def test_inverse_after_forward_is_the_identity_on_what_drives_the_body(case: str):
    m = model(case)
    where = (m.structure, m.geometry, [float(v) for v in m.theta])
    at = random_instant(np.random.default_rng(1))
    at = replace(at, acceleration=dynamics.forward_dynamics(floats, *where, at))
    demanded = dynamics.wrench(floats, *where, at)
    driving = np.array(at.torque) @ m.joint_jacobian
    np.testing.assert_allclose(demanded, driving, rtol=1e-12, atol=1e-12)


def test_a_friction_that_eats_all_torque_is_refused():
    m = model("base").with_effect("load_dependent_friction", share=0.9)
    theta = m.theta.copy()
    theta[m.structure.parameter_names.index("load_dependent_friction.share")] = 1.2
    at = Instant((0.5, 0.0, 0.0), (1.0, 0.0, 0.0))
    with pytest.raises(InputError, match="no torque drives this motion"):
        dynamics.inverse_dynamics(floats, m.structure, m.geometry, theta, at)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_inverse_dynamics_converges_up_to_the_largest_share(share: float):
    m = model("base").with_effect("load_dependent_friction", share=share)
    where = (m.structure, m.geometry, m.theta)
    at = random_instant(np.random.default_rng(0), 500)
    torque = dynamics.acting_torque(np, *where, at)
    back = dynamics.forward_dynamics(np, *where, replace(at, torque=torque))
    np.testing.assert_allclose(back, np.array(at.acceleration), rtol=0, atol=1e-10)


# --- Y theta = wrench ------------------------------------------------------------------------


def free_indices(structure: ModelStructure) -> list[int]:
    """Places in theta of the parameters that are identified linearly."""
    return [
        where.start + k
        for item, where in structure.slices
        for k, name in enumerate(item.parameter_names)
        if not item.parameter(name).is_shape
    ]


def with_only(theta: np.ndarray, free: list[int], index: int) -> np.ndarray:
    unit = theta.copy()
    unit[free] = 0.0
    unit[index] = 1.0
    return unit


LINEAR = [c for c in CASES if not model(c).structure.base_readers | model(c).structure.nonlinear]


@pytest.mark.parametrize("case", LINEAR)
def test_regressor_times_parameters_is_the_wrench(case: str):
    """Where no effect multiplies base parameters the columns are the wrench on unit vectors."""
    m = model(case)
    at = random_instant(np.random.default_rng(2), 50)
    free = free_indices(m.structure)
    with np.errstate(divide="ignore", invalid="ignore"):  # no mass has no centre; nobody asks
        columns = [
            np.array(np.broadcast_arrays(*dynamics.wrench(np, m.structure, m.geometry, unit, at)))
            for unit in (with_only(m.theta, free, i) for i in free)
        ]
    predicted = sum(m.theta[i] * column for i, column in zip(free, columns, strict=True))
    wrench = np.array(dynamics.wrench(np, m.structure, m.geometry, m.theta, at))
    np.testing.assert_allclose(predicted, wrench, rtol=0, atol=1e-12 * np.abs(wrench).max())


@pytest.mark.parametrize("case", [c for c in CASES if model(c).structure.base_readers])
def test_effects_that_multiply_base_parameters_are_linear_in_the_base(case: str):
    """For given effects the wrench is linear in the base: that of a sum is the sum of both."""
    m = model(case)
    at = random_instant(np.random.default_rng(3), 50)

    def wrench(base: np.ndarray) -> np.ndarray:
        theta = np.concatenate([base, m.theta[7:]])
        return np.array(dynamics.wrench(np, m.structure, m.geometry, theta, at))

    first, second = m.theta[:7], m.theta[:7] * np.linspace(0.4, 1.7, 7)
    offset = wrench(np.full(7, 1e-300))  # no base at all, short of dividing by no mass
    both = wrench(first + 2 * second) - offset
    apart = (wrench(first) - offset) + 2 * (wrench(second) - offset)
    np.testing.assert_allclose(both, apart, rtol=0, atol=1e-11 * np.abs(both).max())


@pytest.mark.parametrize("name", [n for n in EFFECTS if CATALOGUE[n].acts_at.kind == "wrench"])
def test_each_wrench_effect_is_linear_in_its_own_parameters_at_catalogue_size(name: str):
    """Exactly, or nearly where the structure knows better and a fit iterates."""
    m, item, values = model(name), CATALOGUE[name], internal_values(name)
    free = [k for k, key in enumerate(item.parameter_names) if not item.parameter(key).is_shape]
    points = EffectPoints(
        np, MECANUM, m.geometry, m.theta, random_instant(np.random.default_rng(4), 50)
    )

    def force(parameters: np.ndarray) -> np.ndarray:
        parts = component_force(item, parameters, points)
        return np.array(np.broadcast_arrays(*parts, np.zeros(50))[:3])

    none = values.copy()
    none[free] = 0.0
    np.testing.assert_array_equal(force(none), 0.0)
    alone = []
    for k in free:
        little = none.copy()
        little[k] = 1e-6 * item.parameter(item.parameter_names[k]).size
        alone.append(values[k] / little[k] * force(little))
    whole, tolerance = force(values), 0.05 if name in m.structure.nonlinear else 1e-12
    assert np.abs(whole).max() > 0
    np.testing.assert_allclose(sum(alone), whole, rtol=0, atol=tolerance * np.abs(whole).max())


def of_kind(*kinds: str) -> list[str]:
    return [name for name in EFFECTS if CATALOGUE[name].acts_at.kind in kinds]


@pytest.mark.parametrize("name", of_kind("shift"))
def test_shifts_are_sums_of_their_parameters(name: str):
    m, item = model(name), CATALOGUE[name]
    where = next(where for known, where in m.structure.slices if known is item)
    delay = dynamics.torque_delay(np, m.structure, m.theta)
    assert delay == pytest.approx(m.theta[where].sum(), rel=1e-15) and delay == m.delay
    assert dynamics.torque_delay(np, mecanum_structure(), model("base").theta) == 0.0
    # At one instant it is transparent.
    at = random_instant(np.random.default_rng(8))
    torque = dynamics.inverse_dynamics(floats, m.structure, m.geometry, m.theta, at)
    expected = model("base").inverse_dynamics(at.twist, at.acceleration)
    np.testing.assert_array_equal(torque, expected)


@pytest.mark.parametrize("name", [n for n in EFFECTS if CATALOGUE[n].inverse is not None])
def test_a_channel_with_an_inverse_of_its_own_is_taken_back_as_far_as_it_goes(name: str):
    """What came through once comes through again; without strength it passes all."""
    item, rng = CATALOGUE[name], np.random.default_rng(9)
    values, torque = internal_values(name), rng.normal(scale=2.0, size=200)
    channel = Channel(torque, 0.0 * torque, 0.0)
    true = np.asarray(item.evaluate(np, channel, values))
    back = np.asarray(item.undo(np, channel._replace(torque=true), values))
    again = np.asarray(item.evaluate(np, channel._replace(torque=back), values))
    np.testing.assert_allclose(again, true, rtol=0, atol=1e-13)
    assert np.abs(true - torque).max() > 0.05
    none = np.array([item.defaults[key] for key in item.parameter_names])
    passed = np.asarray(item.evaluate(np, channel, none))
    np.testing.assert_allclose(passed, torque, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "name", [n for n in of_kind("actuator", "channel") if CATALOGUE[n].inverse is None]
)
def test_drives_and_channels_are_affine_in_torque_and_parameters(name: str):
    """A column each: the torque they map to is the torque plus columns times parameters."""
    item = CATALOGUE[name]
    rng = np.random.default_rng(5)
    torque, rate, time, last = rng.normal(size=(4, 40))
    point = item.acts_at.point(torque, rate, time, last)
    values = internal_values(name)
    free = [k for k, key in enumerate(item.parameter_names) if not item.parameter(key).is_shape]
    none = values.copy()
    none[free] = 0.0

    def mapped(point: Any, values: np.ndarray, wheel: int) -> np.ndarray:
        return np.asarray(item.evaluate(np, point, values, wheel))

    for wheel in range(4):
        identity = mapped(point, none, wheel)
        np.testing.assert_allclose(identity, torque, rtol=1e-15)
        columns = [mapped(point, with_only(values, free, k), wheel) - torque for k in free]
        predicted = torque + sum(values[k] * c for k, c in zip(free, columns, strict=True))
        np.testing.assert_allclose(mapped(point, values, wheel), predicted, rtol=1e-13)
        doubled = point._replace(torque=2 * torque)
        slope = mapped(doubled, values, wheel) - mapped(point, values, wheel)
        tripled = point._replace(torque=3 * torque)
        again = mapped(tripled, values, wheel) - mapped(doubled, values, wheel)
        np.testing.assert_allclose(again, slope, rtol=1e-12, atol=1e-13)


# --- mass matrix -----------------------------------------------------------------------------


@st.composite
def physical_bodies(draw: st.DrawFn) -> dict[str, float]:
    """Parameters of a real body: point masses on the platform give mass, moments and inertia."""
    count = draw(st.integers(1, 5))
    length = st.floats(-0.6, 0.6)
    masses = [draw(st.floats(0.5, 40.0)) for _ in range(count)]
    x, y = [draw(length) for _ in range(count)], [draw(length) for _ in range(count)]
    mass = sum(masses)
    wheels = 4 * 1.4
    inertia = sum(m * (a * a + b * b) for m, a, b in zip(masses, x, y, strict=True))
    return {
        "m0": mass + wheels,
        "I0": inertia + wheels * (0.15**2 + 0.2355**2) + draw(st.floats(0.0, 3.0)),
        "I1": draw(st.floats(0.0, 0.05)),
        "aX": sum(m * a for m, a in zip(masses, x, strict=True)) / mass,
        "aY": sum(m * b for m, b in zip(masses, y, strict=True)) / mass,
        "mu1": draw(st.floats(0.0, 1.0)),
        "mu2": draw(st.floats(0.0, 0.1)),
    }


@given(physical_bodies(), st.sampled_from(CASES), st.integers(0, 1000))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_mass_matrix_is_symmetric_positive_definite(values: dict[str, float], case: str, seed: int):
    m = model(case).with_values(values)
    at = random_instant(np.random.default_rng(seed))
    matrix = np.array(dynamics.mass_matrix(np, m.structure, m.geometry, m.theta, at))
    scale = np.abs(matrix).max()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-12 * scale)
    assert np.linalg.eigvalsh(matrix).min() > 0


def test_a_body_that_cannot_be_is_refused():
    parameters = {
        name: Estimate(value, unit)
        for (name, unit), value in zip(
            BASE_UNITS.items(), (35.0, 0.05, 0.0, 0.3, 0.3, 0.1, 0.005), strict=True
        )
    }
    with pytest.raises(InputError, match="positive definite"):
        Model(Geometry(), parameters)


# --- kinematics ------------------------------------------------------------------------------


def test_wheel_rates_obey_the_four_wheel_identity():
    """phi_1' + phi_2' - phi_3' - phi_4' = 0, and each rate as the paper writes it."""
    g = Geometry(l=0.2, h=0.3, R=0.06, r=0.011)
    vx, vy, w = twist = np.random.default_rng(0).normal(size=(3, 100))
    rates = np.array(wheel_rates(g, tuple(twist)))
    lw = (g.l + g.h) * w
    explicit = np.array([vx - vy - lw, vx + vy + lw, vx + vy - lw, vx - vy + lw]) / g.R
    np.testing.assert_allclose(rates, explicit, rtol=0, atol=1e-13)
    np.testing.assert_allclose(g.slip(rates.T), 0.0, atol=1e-12)
    np.testing.assert_allclose(rates.T, g.wheel_speeds(twist.T), atol=1e-12)
    np.testing.assert_allclose(g.body_twist(rates.T), twist.T, atol=1e-12)


def test_roller_rates_are_as_the_paper_writes_them():
    g = Geometry(l=0.2, h=0.3, R=0.06, r=0.011)
    twist = np.random.default_rng(0).normal(size=(3, 100))
    x = np.array([g.h, g.h, -g.h, -g.h])
    d = np.arctan(SIGN_LATERAL)
    explicit = -(twist[1] + np.outer(x, twist[2])) / (g.r * np.cos(d))[:, None]
    rates = np.array(roller_rates(g, tuple(twist)))
    np.testing.assert_allclose(rates, explicit, rtol=1e-13)
    np.testing.assert_allclose(rates.T, twist.T @ g.roller_jacobian.T, rtol=1e-12)


def test_force_and_speed_maps_are_transposes():
    """Torques do the same work on the wheels as their generalised force on the body."""
    g = Geometry()
    rng = np.random.default_rng(0)
    torque, twist = rng.normal(size=(4, 50)), rng.normal(size=(3, 50))
    force = np.array(body_force(g, list(torque)))
    rates = np.array(wheel_rates(g, tuple(twist)))
    np.testing.assert_allclose((torque * rates).sum(0), (force * twist).sum(0), rtol=1e-11)
    np.testing.assert_allclose(force.T, g.body_force(torque.T), rtol=1e-12)
    back = body_force(g, allocate(g, tuple(force)))
    np.testing.assert_allclose(back, force, rtol=1e-12)
    np.testing.assert_allclose(np.array(allocate(g, tuple(force))).T, g.wheel_torque(force.T))


# --- friction --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "item", [e for e in (*BASE, *CATALOGUE) if e.dissipative], ids=lambda e: e.name
)
def test_friction_never_adds_energy(item):
    m = model("base")
    rng = np.random.default_rng(6)
    upper = [min(p.upper, 20 * p.size) for p in item.parameters for _ in p.names]
    lower = [max(p.lower, 0.0) for p in item.parameters for _ in p.names]
    for _ in range(50):
        values = rng.uniform(lower, upper)
        at = random_instant(rng, 40)
        points = EffectPoints(np, MECANUM, m.geometry, m.theta, at)
        force = np.array(component_force(item, values, points)[:3], dtype=object)
        power = sum(f * v for f, v in zip(force, at.twist, strict=True))
        assert np.min(power) >= -1e-12 * np.max(np.abs(power))
        assert np.max(power) > 0


def test_friction_that_adds_energy_would_be_seen():
    """The test above can fail: a friction with the wrong sign has negative power."""
    item = replace(
        CATALOGUE["wheel_coulomb_friction"],
        function=lambda xp, wheel, torque, smoothing: -torque * xp.tanh(wheel.rate / smoothing),
    )
    with pytest.raises(AssertionError):
        test_friction_never_adds_energy(item)


@pytest.mark.parametrize(
    "item",
    [e for e in (*BASE, *CATALOGUE) if e.acts_at.kind == "wrench" and not e.dissipative],
    ids=lambda e: e.name,
)
def test_what_only_takes_energy_is_called_dissipative(item):
    m = model("base")
    rng = np.random.default_rng(7)
    powers = []
    for _ in range(30):
        values = [p.default or p.size for p in item.parameters for _ in p.names]
        at = random_instant(rng)
        force = component_force(
            item, values, EffectPoints(floats, MECANUM, m.geometry, m.theta, at)
        )
        powers.append(sum(f * v for f, v in zip(force, at.twist, strict=True)))
    assert min(powers) < 0 < max(powers), f"{item.name} only takes energy: say dissipative=True"


@pytest.mark.parametrize(
    "item", [e for e in (*BASE, *CATALOGUE) if e.acts_at.kind == "wrench"], ids=lambda e: e.name
)
def test_what_is_smooth_depends_on_no_acceleration_and_the_rest_does(item):
    """At a sample of a log accelerations jump, and torques with them."""
    m = model("base")
    structure = mecanum_structure([item.name] if item.name in CATALOGUE else [])
    rng, differs = np.random.default_rng(8), False
    for _ in range(30):
        values = [p.default or p.size for p in item.parameters for _ in p.names]
        at, other = random_instant(rng), random_instant(rng)
        jumped = replace(at, acceleration=other.acceleration, torque=other.torque)
        first, second = (
            component_force(item, values, EffectPoints(floats, MECANUM, m.geometry, m.theta, one))
            for one in (at, jumped)
        )
        differs |= first != second
    assert differs == (item.name not in structure.smooth_components)


@pytest.mark.parametrize("name", EFFECTS)
def test_catalogue_entries_are_usable(name: str):
    """What `youbot effects` and a fit rely on: sizes within bounds, a source, one sentence."""
    item = CATALOGUE[name]
    for parameter in (*item.parameters, *item.public_parameters):
        size = parameter.default if parameter.is_shape else parameter.size
        assert set(parameter.grid) <= {v for v in parameter.grid if v >= parameter.lower}
        # A switch may be off by default.
        assert size is not None and (size > 0 or parameter.whole and size == 0)
        assert parameter.lower <= size <= parameter.upper
        assert parameter.unit
        assert parameter.relative_to in (None, "mean", "least", "internal")
        assert parameter.absorbed_by in (None, *BASE_UNITS)
    assert item.source and item.recognise.endswith(".")
    assert item.function.__doc__
    spread = SimpleNamespace(**catalogue_values(name))
    assert set(vars(spread)) == set(item.public_defaults)
