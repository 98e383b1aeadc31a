"""identify and compare as a whole, on recordings of known plants and on given logs."""

import json
from dataclasses import replace

import numpy as np
import pytest

import identification
from identification.comparison import compare, write_predictions
from identification.fitting.errors import SumsOfSquares, force_traces, velocity_traces
from identification.fitting.identify import identify
from identification.logs.findings import Finding
from identification.logs.log import Log
from identification.logs.reading import read_log
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.plausibility import warnings_of
from tests.identification.blind_logs import FEW, blind_logs
from tests.identification.recordings import recording
from tests.identification.shared_data import DATA, needs_data, theta, truth
from tests.sparing import mostly_slow
from youbot_env.errors import InputError
from youbot_env.model.model_file import load_model, model_from_dict, model_to_dict
from youbot_env.physics.geometry import Geometry
from youbot_env.physics.mecanum import mecanum_structure

PAPER = load_model("paper")

TOLERANCE = {"m0": 0.015, "I0": 0.02, "I1": 0.06, "mu1": 0.005, "mu2": 0.005}
"""Largest relative errors; aX and aY may be off by 2.5 mm."""


def check_recovery(model, expected):
    for name, value in expected.items():
        estimate = model.parameters[name]
        allowed = 0.0025 if name in ("aX", "aY") else TOLERANCE[name] * abs(value)
        assert abs(estimate.value - value) <= max(3 * estimate.std, allowed), name


@needs_data
@pytest.mark.parametrize(
    "name", mostly_slow(["nominal_1", "nominal_2", "nominal_3"], ["nominal_1"])
)
def test_given_platforms_come_back_and_predict_held_out_runs(name):
    result = identify([read_log(DATA / name / "calibration.csv")])
    check_recovery(result.model, truth(name))
    engine = Mecanum(Geometry(), mecanum_structure())
    for run in ("multisine_a", "multisine_b"):
        log = read_log(DATA / name / f"{run}.csv")
        found = compare(result.model, [log]).to_dict()
        samples = engine.samples(log)
        best = theta(truth(name))
        force = SumsOfSquares.of(force_traces(engine, best, samples)).ratio
        velocity = SumsOfSquares.of(velocity_traces(engine, best, samples)).ratio
        assert found["total"]["force_error"] < 1.1 * force
        assert found["total"]["velocity_error"] < 1.1 * velocity
        assert found["noise_floor"]["force_error"] == pytest.approx(force, rel=0.1)


@pytest.mark.slow
@needs_data
def test_contact_simulator_is_explained_and_its_weak_separation_stated():
    folder = DATA / "mujoco_nominal"
    result = identify([read_log(folder / "calibration.csv")])
    found = compare(result.model, [read_log(folder / "multisine.csv")]).to_dict()
    assert 1 - found["total"]["velocity_error"] ** 2 > 0.99
    value, radius = result.model.values, 0.0475
    effective = value["m0"] + 4 * value["I1"] / radius**2
    assert effective == pytest.approx(35.3 + 4 * 0.006 / radius**2, rel=0.04)
    covariance = result.model.covariance
    assert covariance is not None
    k, j = (result.model.covariance_names.index(name) for name in ("m0", "I1"))
    weight = np.zeros(len(covariance))
    weight[k], weight[j] = 1.0, 4 / radius**2
    together = np.sqrt(weight @ covariance @ weight) / effective
    apart = np.sqrt(covariance[j, j]) / value["I1"]
    assert apart > 5 * together


@pytest.mark.parametrize(
    ("rate", "noise"),
    mostly_slow(
        [(50.0, 2.0), (100.0, 1.0), (250.0, 2.0)], [(50.0, 2.0), (250.0, 2.0)], several=True
    ),
)
def test_recordings_come_back_at_every_rate_and_noise(rate, noise):
    result = identify([recording(rate=rate, noise=noise, seed=5)])
    check_recovery(result.model, {name: e.value for name, e in PAPER.parameters.items()})


def test_output_error_step_agrees_with_the_force_fit():
    result = identify([recording()], output_error=True)
    difference = np.abs(result.fit.theta - result.force.theta)
    assert (difference < 3 * (result.fit.std + result.force.std)).all()
    assert (difference > 0).any()
    before, after = (
        SumsOfSquares.of(velocity_traces(result.mechanism, t, result.samples[0])).ratio
        for t in (result.force.theta, result.fit.theta)
    )
    assert after <= before
    assert result.model.errors["velocity_error"] == pytest.approx(after)


@pytest.mark.slow
def test_an_effect_of_the_start_model_is_fitted_too():
    planted = (("uneven_wheel_friction", (("extra_bl", 0.1),)),)
    start = PAPER.with_effect("uneven_wheel_friction")
    model = identify([recording(effects=planted)], start=start).model
    found = {name: e.value for name, e in model.effects["uneven_wheel_friction"].items()}
    # Relative to the least: one wheel is at zero exactly and the common part is in mu1.
    assert min(found.values()) == 0.0
    assert found["extra_bl"] == pytest.approx(0.1, rel=0.03)
    assert max(found[f"extra_{w}"] for w in ("fl", "fr", "br")) < 0.003
    assert model.values["mu1"] == pytest.approx(0.11, rel=0.03)
    again = model_from_dict(json.loads(json.dumps(model_to_dict(model))))
    assert again.values == model.values


def test_several_logs_are_one_fit_and_better_than_each():
    together = identify([recording("I"), recording()])
    alone = identify([recording()])
    assert (together.fit.std[-2:] < alone.fit.std[-2:]).all()
    assert [log["name"] for log in together.model.logs] == ["I", "calibration"]


def test_says_unasked_what_can_hardly_be():
    result = identify([recording()])
    warnings = " ".join(result.warnings)
    assert "rotor" in warnings
    # That of the paper's own platform is beyond the wheels too: no news from a log of it.
    assert "gyration radius" not in warnings
    another = result.model.with_values({"m0": 25.0, "I0": 3.2})
    assert "gyration radius" in " ".join(warnings_of(another))


def test_json_form_holds_intervals_and_is_plain():
    result = identify([recording()])
    found = json.loads(json.dumps(result.to_dict()))
    for name, entry in found["parameters"].items():
        low, high = entry["interval"]
        assert low < entry["value"] < high
        assert high - low == pytest.approx(2 * 1.96 * entry["std"])
        assert entry["value"] == result.model.values[name]
    kinds = [part["kind"] for part in found["observability"]["parts"]]
    assert list(dict.fromkeys(kinds)) == ["I", "III", "II", "IV"]


def test_same_input_gives_the_same_numbers_to_the_bit():
    first, second = (identify([recording()], seed=3).to_dict() for _ in range(2))
    assert first == second


def test_functions_of_the_package_are_the_commands():
    assert identification.identify is identify
    assert identification.compare is compare


# compare ---------------------------------------------------------------------------------------


def test_true_parameters_reach_the_noise_floor():
    found = compare(PAPER, [recording()]).to_dict()
    for kind in ("force_error", "velocity_error"):
        assert found["total"][kind] == pytest.approx(found["noise_floor"][kind], rel=0.15)
    assert set(found["logs"]["calibration"]) >= {
        "force_error", "velocity_error", "force_error_by_axis", "velocity_error_by_axis",
        "seen_in_fit",
    }  # fmt: skip


def test_a_missing_effect_stands_out_above_the_floor():
    planted = (("wheel_coulomb_friction", (("torque", 0.25),)),)
    found = compare(PAPER, [recording(effects=planted)]).to_dict()
    assert found["total"]["force_error"] > 5 * found["noise_floor"]["force_error"]
    assert found["where"][0]["variable"] == "twist" and found["where"][0]["share"] > 0.9
    shares = [row["share"] for row in found["stretches"]]
    assert shares == sorted(shares, reverse=True) and 0 < sum(shares) <= 1
    slip = found["logs"]["calibration"]["slip"]
    assert not slip["exceeds_noise"] and 0 < slip["ratio"] < 0.01


def renamed(log: Log, name: str, sha256: str) -> Log:
    from dataclasses import replace

    return replace(log, name=name, sha256=sha256)


@pytest.mark.slow
def test_logs_of_the_fit_are_marked_and_left_out_of_totals_unless_all_are():
    seen = renamed(recording(), "seen", "a" * 64)
    other = renamed(recording("I"), "other", "b" * 64)
    model = identify([seen]).model
    both = compare(model, [seen, other]).to_dict()
    assert both["logs"]["seen"]["seen_in_fit"] and not both["logs"]["other"]["seen_in_fit"]
    assert both["total"]["force_error"] == both["logs"]["other"]["force_error"]
    alone = compare(model, [seen]).to_dict()
    assert alone["total"]["force_error"] == alone["logs"]["seen"]["force_error"]


@pytest.mark.slow
def test_velocity_error_is_the_free_runs_ratio():
    log = recording("I")
    result = compare(PAPER, [log])
    item = result.logs[0]
    measured = Geometry().body_twist(log.velocity) / np.array([0.3855, 0.3855, 1.0])
    predicted = Geometry().body_twist(item.joint_speed) / np.array([0.3855, 0.3855, 1.0])
    expected = np.sqrt(((measured - predicted) ** 2).sum() / (measured**2).sum())
    found = result.to_dict()["logs"]["I"]
    assert found["velocity_error"] == pytest.approx(expected, rel=1e-9)


def test_predictions_have_one_row_a_row_of_the_file(tmp_path):
    log = recording("I")
    item = compare(PAPER, [log]).logs[0]
    write_predictions(tmp_path / "I.csv", item)
    table = np.genfromtxt(tmp_path / "I.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["time"], log.file_time)
    np.testing.assert_allclose(table["velocity_br"], item.joint_speed[:, 3], atol=1e-9)


def test_a_model_that_diverges_is_said_so():
    unstable = PAPER.with_effect("torque_gain_error", gain_fl=2.0)
    assert compare(unstable, [recording("I")]).to_dict()["total"]["velocity_error"] > 0.1
    with pytest.raises(InputError, match="at least one"):
        compare(PAPER, [])


@pytest.mark.parametrize("stiff", [False, True])
def test_a_free_run_that_diverges_has_no_error_and_is_told(tmp_path, monkeypatch, stiff: bool):
    sound = Mechanism.free_run

    def diverging(mechanism, theta, samples):
        if stiff:
            raise InputError("too stiff to simulate")
        run = sound(mechanism, theta, samples)
        return run * np.exp(np.minimum(np.arange(len(run)), 700.0))[:, None]

    monkeypatch.setattr(Mechanism, "free_run", diverging)
    result = compare(PAPER, [recording("I")])
    found = result.to_dict()
    assert found["diverges"] == ["I"]
    assert np.isnan(found["total"]["velocity_error"])
    assert np.isnan(found["noise_floor"]["velocity_error"])
    assert np.isfinite(found["total"]["force_error"])
    write_predictions(tmp_path / "I.csv", result.logs[0])
    table = np.genfromtxt(tmp_path / "I.csv", delimiter=",", names=True)
    assert np.isfinite(table["velocity_fl"][0]) != stiff
    assert np.isnan(table["velocity_fl"][-1])


def test_what_is_wrong_with_a_log_is_told_before_the_misfit() -> None:
    log = recording(effects=(("wheel_coulomb_friction", (("torque", 0.3),)),), rate=50.0)
    told = Finding("warning", "the clock jumps")
    found = identify([replace(log, findings=(*log.findings, told))], recursive=False)
    assert found.misfit
    jumps = next(k for k, line in enumerate(found.warnings) if "the clock jumps" in line)
    assert jumps < found.warnings.index(found.misfit) < found.told_first


@pytest.mark.parametrize("names", FEW)
def test_a_load_that_is_put_on_in_one_of_two_logs_is_a_misfit(names) -> None:
    mass = {"mass": 12.0, "time": 30.0}
    logs = blind_logs("payload_change", names, mass, only_in=("multisine_a",))
    found = identify(logs, recursive=False)
    errors = found.model.errors
    assert found.misfit and "the model lacks something" in found.misfit
    assert errors["noise_floor"]["force_error"] < 0.8 * errors["force_error"]


@pytest.mark.parametrize("kind", ["none", "torque_wander"])
def test_noise_of_two_logs_is_no_misfit(kind) -> None:
    assert identify(blind_logs(kind, FEW[0], seed=8), recursive=False).misfit is None
