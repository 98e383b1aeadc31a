import warnings
from dataclasses import replace

import numpy as np
import pytest

from identification.fitting.covariance import hac_covariance
from identification.fitting.gauge import gauge_basis
from identification.fitting.least_squares import _bounded_step, fit
from identification.fitting.regression import acting_share, regression, regressions, stride
from identification.fitting.settings import FitSettings
from identification.logs.reading import read_log
from identification.mechanisms.mecanum import Mecanum
from identification.proposal.law import FoundLaw
from identification.signals.filters import FilterSettings, block_mean, filter_samples, settled
from tests.identification.proposal.laws import every_law
from tests.identification.recordings import recording
from tests.identification.shared_data import DATA, needs_data, theta, truth
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.inverse_dynamics import wrench
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.physics.mechanism import Instant
from youbot_env.plugins import load_effects

PAPER = load_model("paper")


def mechanism(*effects: str) -> Mecanum:
    return Mecanum(Geometry(), mecanum_structure(effects))


SHAPES = {"payload_change": {"time": 70.0}}
"""Shape constants at which the calibration motions show an effect; the defaults for all others."""


def at_size(*names: str):
    """The paper's model with effects at their catalogue size."""
    model = PAPER
    for name in names:
        effect = CATALOGUE[name]
        values = {
            # Not quite: a delay of whole samples would sit on a knot of the interpolation.
            key: 0.97 * parameter.size if not parameter.each_wheel or key.endswith("_fl") else 0.0
            for key in effect.public_names
            if not (parameter := effect.public_parameter(key)).is_shape
        }
        model = model.with_effect(name, **values | SHAPES.get(name, {}))
    return model


@pytest.mark.parametrize("names", [(), *[(effect.name,) for effect in CATALOGUE]])
def test_columns_are_the_derivatives_of_the_demanded_force(names):
    model = at_size(*names)
    engine = mechanism(*names)
    # The long one only for what begins late.
    samples = engine.samples(recording("calibration" if set(names) & set(SHAPES) else "III"))
    free = np.flatnonzero(engine.free)
    columns = engine.demand(model.theta, samples).columns(free)
    for k, index in enumerate(free):
        step = 1e-4 / engine.scale[index]
        ahead, behind = model.theta.copy(), model.theta.copy()
        ahead[index] += step
        behind[index] -= step
        forces = [engine.demand(shifted, samples).force for shifted in (ahead, behind)]
        expected = (forces[0] - forces[1]) / (2 * step)
        apart = np.abs(columns[k] - expected) / np.abs(expected).max()
        # A difference across the kink of |M| depends on its step; such samples are few. Where the
        # force bends with the parameter (a delay), the engine's wider step adds its third order.
        limit = 2e-4 if engine.structure.nonlinear else 1e-5
        # A channel with an inverse of its own has a kink, and more samples lie at it.
        limit = 5e-3 if engine.structure.has_nonlinear_channel else limit
        assert np.quantile(apart, 0.99) < limit


def test_rows_of_a_limit_fall_with_the_error_as_a_share_of_what_acts():
    engine, limit = mechanism("torque_saturation"), 7
    log = engine.samples(recording("III"))
    theta = np.append(1.1 * PAPER.theta, 0.5 * np.abs(log.torque).max())

    def share(value: float) -> float:
        moved = theta.copy()
        moved[limit] = value
        (row,) = regressions(engine, moved, [log], free)
        return float((row.residual**2).sum()) / acting_share(engine, moved, [log])

    free = np.flatnonzero(engine.free)
    (row,) = regressions(engine, theta, [log], free)
    slope = -2 * np.einsum("na,naf->f", row.residual, row.columns)[limit]
    step = 1e-3 * theta[limit]
    expected = (share(theta[limit] + step) - share(theta[limit] - step)) / (2 * step)
    assert 0.0 < acting_share(engine, theta, [log]) < 1.0
    assert slope / acting_share(engine, theta, [log]) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("start", [0.3, 1.5])
def test_a_limit_does_not_slide_to_where_no_torque_acts(start):
    """Least squares of forces alone end at the lower bound: what acts there is a hundredth."""
    tether = ("tether", (("stiffness", 3.0), ("anchor_x", 1.0), ("anchor_y", -1.0)))
    log = recording("III", (("torque_saturation", (("limit", 0.5),)), tether), rate=50.0)
    engine = mechanism("torque_saturation")
    found = fit(engine, [engine.samples(log)], np.append(PAPER.theta, start))
    assert found.theta[-1] == pytest.approx(0.5, rel=0.1)
    assert 0.1 < found.acting_share < 0.5


def test_noise_free_log_gives_the_parameters_back():
    log = recording(noise=0.0)
    engine = mechanism()
    found = fit(engine, [engine.samples(log)], np.zeros(7) + PAPER.theta * 0.5)
    error = (found.theta - PAPER.theta) * engine.scale
    # What is left is the first-order hold's error, of order (omega dt)^2.
    assert np.abs(error).max() < 2e-4 * np.abs(PAPER.theta * engine.scale).max()


@needs_data
def test_first_order_hold_does_not_bias_the_wheels_inertia_and_zero_order_hold_does():
    engine, expected = mechanism(), theta(truth("nominal_2"))
    samples = engine.samples(read_log(DATA / "nominal_2" / "calibration.csv"))
    good = fit(engine, [samples], PAPER.theta)
    held = _zero_order_hold_fit(engine, samples)
    inertia = engine.parameter_names.index("I1")
    assert abs(good.theta[inertia] / expected[inertia] - 1) < 0.06
    assert abs(held[inertia] / expected[inertia] - 1) > 0.10


def _zero_order_hold_fit(engine, samples):
    """The trap: every signal held for a sample, its filtered derivative a_f (s - s_f)."""
    decay = np.exp(-FilterSettings.rate * samples.dt)

    def hold(signal):
        out = np.zeros_like(signal)
        for k in range(len(signal) - 1):
            out[k + 1] = decay * out[k] + (1 - decay) * signal[k]
        return out

    def columns(twist, acceleration):
        at = Instant(tuple(twist.T), tuple(acceleration.T))
        units = [wrench(np, engine.structure, engine.geometry, unit, at) for unit in np.eye(7)]
        forces = [np.stack(np.broadcast_arrays(*f, twist[:, 0])[:3], axis=-1) for f in units]
        return np.stack(forces, axis=-1) * engine.force_scale[:, None]

    slope = FilterSettings.rate * (samples.twist - hold(samples.twist))
    still = np.zeros_like(samples.twist)
    rows = columns(still, slope) + hold(columns(samples.twist, still))
    measured = hold(engine.measured_force(samples))
    first = settled(FilterSettings.rate, samples.dt)
    matrix = rows[first:].reshape(-1, 7) / engine.scale
    return np.linalg.lstsq(matrix, measured[first:].ravel(), rcond=None)[0] / engine.scale


SHARED_BY_WHEELS = {"uneven_roller_friction", "roller_angle_error"}
"""Effects whose values of single wheels forces cannot show (the front rollers have one rate):
the force that they make is compared."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [effect.name for effect in CATALOGUE])
def test_every_effect_comes_back_from_a_log_that_has_it(name):
    model = at_size(name)
    planted = tuple(
        (key.split(".")[1], value)
        for key, value in model.values.items()
        if key.startswith(name + ".")
    )
    # Half the noise: wheel angles that are integrated from noisy speeds lose their phase.
    log = recording(effects=((name, planted),), noise=0.5)
    engine = mechanism(name)
    # What has no linear beginning (a limit that nothing reaches) starts from its grid.
    grids = {p.name: p.grid[len(p.grid) // 2] for p in CATALOGUE[name].parameters if p.grid}
    starts = {k: v for k, v in grids.items() if not CATALOGUE[name].parameter(k).is_shape}
    start = PAPER.with_effect(name, **SHAPES.get(name, {}), **starts).theta
    samples = engine.samples(log)
    found = fit(engine, [samples], start)
    if name in SHARED_BY_WHEELS:
        forces = [engine.demand(t, samples).force for t in (found.theta, model.theta, start)]
        left, lacking = forces[0] - forces[1], forces[2] - forces[1]
        assert np.sqrt(np.mean(left**2)) < 0.05 * np.sqrt(np.mean(lacking**2))
        return
    # Relative parameters are compared by their differences, which are all that data can show.
    basis = gauge_basis(engine)
    difference = (found.theta - model.theta)[found.free] * engine.scale[found.free]
    size = np.abs(model.theta * engine.scale)[found.free]
    seen = basis @ basis.T @ difference
    own = [k for k, i in enumerate(found.free) if engine.labels[i].component == name]
    assert np.abs(seen[own]).max() < 0.05 * size[own].max()


def test_robust_fit_shrugs_off_outliers_that_ruin_the_plain_one():
    engine = mechanism()
    samples = engine.samples(recording())
    torque = samples.torque.copy()
    rng = np.random.default_rng(0)
    for start in rng.integers(0, len(torque) - 40, 25):
        torque[start : start + 40] += 2.0
    spoiled = replace(samples, torque=torque)
    errors = {}
    for robust in (False, True):
        found = fit(engine, [spoiled], PAPER.theta, robust=robust)
        errors[robust] = np.abs((found.theta - PAPER.theta) * engine.scale).max()
    assert errors[True] < 0.5 * errors[False]


def test_estimates_stay_inside_physical_bounds():
    engine = mechanism("load_dependent_friction")
    start = PAPER.with_effect("load_dependent_friction").theta
    found = fit(engine, [engine.samples(recording("III"))], start)
    lower, upper = engine.bounds
    assert (found.theta >= lower - 1e-12).all() and (found.theta <= upper + 1e-12).all()


def test_what_no_data_can_see_stays_where_it_is_where_a_bound_acts():
    """Offsets of the torques of which a part exerts no force, and a friction that would go below
    zero."""
    engine = mechanism("torque_offset")
    samples = engine.samples(recording())
    driven = replace(samples, torque=samples.torque - 0.2 * samples.wheel_speed)
    found = fit(engine, [driven], PAPER.with_effect("torque_offset").theta)
    assert found.bounded
    offsets = found.theta[-4:]
    assert np.abs(offsets).max() < 1.0
    assert offsets @ np.array(engine.internal) == pytest.approx(0.0, abs=1e-6)


def test_the_common_part_of_gains_stays_where_it_is_where_a_bound_acts(monkeypatch, tmp_path):
    """Gains of the torques, and a friction that would go below zero: what the log has is neither,
    but a friction that changes over the floor."""
    monkeypatch.setattr(CATALOGUE, "_effects", dict(CATALOGUE._effects))
    law = next(law for law in every_law() if law.name == "dry_wheel_friction_by_place")
    planted = {"level": 0.15, "along_x": 0.0, "along_y": 0.1}
    path = tmp_path / "place.py"
    path.write_text(FoundLaw(law, planted | {"smoothing": 0.1}).file_text("Planted."))
    load_effects(path)
    log = recording("calibration", ((law.name, tuple(planted.items())),), 50.0)
    engine = mechanism("wheel_stribeck_friction", "torque_gain_error")
    start = np.concatenate([PAPER.theta, [0.2, 0.1, 0.5, 0.03, 0.0, 0.0, 0.0, 0.0]])
    found = fit(engine, [engine.samples(log)], start)
    assert found.bounded
    assert found.theta[-4:].sum() == pytest.approx(0.0, abs=1e-3)
    assert found.theta[0] == pytest.approx(PAPER.values["m0"], rel=0.1)


def test_a_fit_that_wanders_about_ends_early_with_the_best_it_has_passed():
    """A load that is not there has no place: its step has no end to arrive at."""
    engine = mechanism("payload_change")
    samples = [engine.samples(recording())]
    start = PAPER.with_effect("payload_change").theta
    steps = []
    found = fit(engine, samples, start, progress=lambda: steps.append(None))
    assert len(steps) < FitSettings().max_steps
    without = fit(mechanism(), samples, PAPER.theta)
    assert found.square < 1.001 * without.square
    again = regression(engine, found.theta, samples[0], found.free)
    np.testing.assert_allclose(again.residual, found.rows[0].residual, atol=1e-9)


def test_too_short_a_log_is_refused_in_words():
    engine = mechanism()
    samples = engine.samples(recording("I"))
    short = replace(
        samples,
        **{
            key: getattr(samples, key)[:70]
            for key in ("time", "twist", "pose", "wheel_angle", "wheel_speed", "torque")
        },
    )
    with pytest.raises(InputError, match="too short"):
        fit(engine, [short], PAPER.theta)


def test_standard_deviations_are_true_for_correlated_residuals():
    """Newey-West covers where the white-noise formula states several times too little."""
    rng = np.random.default_rng(2)
    count, decay = 2800, np.exp(-0.5)
    inside_hac = inside_white = 0
    trials = 300
    for _ in range(trials):
        column = _coloured(rng, count, decay)
        noise = _coloured(rng, count, decay)
        estimate = column @ noise / (column @ column)
        residual = noise - column * estimate
        rows = ([residual[:, None]], [column[:, None, None]], [0.05])
        std = float(np.sqrt(hac_covariance(*rows, np.eye(1), np.ones(1))[0, 0]))
        white = float(np.sqrt(residual.var() / (column @ column)))
        inside_hac += abs(estimate) < 1.96 * std
        inside_white += abs(estimate) < 1.96 * white
    assert 0.91 < inside_hac / trials < 0.985
    assert inside_white / trials < 0.85


def _coloured(rng, count, decay):
    white = rng.standard_normal(count)
    out = np.empty(count)
    out[0] = white[0]
    for k in range(1, count):
        out[k] = decay * out[k - 1] + white[k]
    return out


def test_rows_of_a_stretch_lie_inside_it():
    engine = mechanism()
    samples = engine.samples(recording())
    rows = regression(engine, PAPER.theta, samples, np.arange(7)).between(40.0, 60.0)
    assert rows.time.min() >= 40.0 and rows.time.max() <= 60.0 + 1e-9
    assert len(rows.time) == pytest.approx(20.0 / rows.step, abs=2)


def test_filter_of_measured_force_equals_the_definition():
    engine = mechanism()
    samples = engine.samples(recording("I"))
    rows = regression(engine, np.zeros(7), samples, np.arange(7))
    filtered = filter_samples(engine.measured_force(samples), FilterSettings.rate, samples.dt)
    expected = block_mean(
        filtered[settled(FilterSettings.rate, samples.dt) :],
        stride(samples.dt, FitSettings().row_rate),
    )
    np.testing.assert_allclose(rows.residual, expected, atol=1e-12)


def test_a_value_that_rounding_left_beside_its_bound_makes_no_warning():
    """lsq_linear alone warns in one of some thirty of such steps."""
    rng, upper = np.random.default_rng(0), np.full(5, np.inf)
    lower = np.array([-6.0, -np.inf, -6e-23, -30.0, -np.inf])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(100):
            matrix, right = rng.standard_normal((8, 5)), 3 * rng.standard_normal(8)
            matrix[:, 4] = -matrix[:, 3]
            step, _ = _bounded_step(
                matrix,
                right,
                np.ones(5),
                np.zeros(5),
                lower,
                upper,
                np.zeros((5, 5)),
                FitSettings(),
            )
            assert (step >= lower).all()
