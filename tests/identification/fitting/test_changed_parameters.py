"""A robot that has changed since its model was made: what has changed is said, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.recording import record
from identification import Log, compare, identify
from identification.fitting.changed_parameters import changed_parameters
from identification.mechanisms.registry import mechanism_of
from tests.identification.recordings import recording
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration
from youbot_env.motions.multisine import multisine


@pytest.fixture(scope="module")
def made() -> Model:
    return identify([recording(seed=1)]).model


def later(**values: float) -> Log:
    """A log of the platform at other parameters."""
    plant = load_model("paper").with_values(values)
    return record(plant, [calibration()], seed=7)[0]


@pytest.mark.slow
def test_a_robot_that_is_the_same_has_not_changed(made: Model):
    found = compare(made, [later()]).changes
    assert found.rows and found.sentences == []
    assert found.to_dict()["tested"]


def test_six_kilograms_more_are_told_with_their_deviation(made: Model):
    changes = compare(made, [later(m0=load_model("paper").values["m0"] + 6.0)]).changes
    changed = {row.name: row for row in changes.changed}
    assert set(changed) == {"m0"}
    assert abs(changed["m0"].size - 6.0) < 3 * changed["m0"].std
    assert "m0 has risen by" in changes.sentences[0] and "kg" in changes.sentences[0]


@pytest.mark.slow
def test_a_friction_that_has_fallen_is_told_in_its_unit(made: Model):
    changes = compare(made, [later(mu1=0.1)]).changes
    assert [row.name for row in changes.changed] == ["mu1"]
    assert changes.changed[0].size == pytest.approx(-0.01, abs=3e-4)
    assert changes.sentences[0].startswith("mu1 has fallen by 0.0")
    assert "N m s since the model was made" in changes.sentences[0]


def test_a_sum_is_told_where_its_members_are_not_known(made: Model):
    """Large and opposite deviations of m0 and I1 hide both, not what they do together."""
    names = list(made.covariance_names)
    a, b = names.index("m0"), names.index("I1")
    covariance = made.covariance.copy()  # type: ignore[union-attr]
    spin = 4 / made.geometry.R**2
    covariance[a, a], covariance[b, b] = 100.0, 100.0 / spin**2
    covariance[a, b] = covariance[b, a] = -100.0 / spin
    vague = replace(made, covariance=covariance)
    heavier = made.with_values({"m0": made.values["m0"] + 6.0})
    heavier = replace(heavier, covariance=made.covariance, covariance_names=made.covariance_names)
    found = changed_parameters(vague, heavier, mechanism_of(made))
    assert [row.name for row in found.changed] == ["m0 + 4 I1/R^2"]


def test_a_change_that_a_new_effect_alone_brings_is_none(made: Model):
    """The robot may always have had the effect: the given model's own structure must say it too."""
    known = {"covariance": made.covariance, "covariance_names": made.covariance_names}
    mass = made.values["m0"]
    other = made.with_values({"m0": mass + 6.0}).with_effect("wheel_creep", slip=0.2)
    heavier, mechanism = replace(other, **known), mechanism_of(made)
    told = {
        alike: [
            row.name
            for row in changed_parameters(
                made, heavier, mechanism, alike={**made.values, "m0": mass + alike}
            ).changed
        ]
        for alike in (-6.0, 0.0, 5.0)
    }
    assert told == {-6.0: [], 0.0: [], 5.0: ["m0"]}


def test_what_was_missing_from_the_start_is_no_change(made: Model):
    errors = {"force_error": 0.2, "noise_floor": {"force_error": 0.01}}
    never_right = replace(made, errors=errors)
    known = {"covariance": made.covariance, "covariance_names": made.covariance_names}
    other = made.with_values({"m0": made.values["m0"] + 6.0})
    heavier, more = (
        replace(model, **known) for model in (other, other.with_effect("floor_tilt", tilt_x=0.01))
    )
    found = changed_parameters(never_right, more, mechanism_of(made))
    assert found.rows == () and found.sentences == []
    assert "20 times the noise floor) for want of floor_tilt" in found.reason
    # Of a structure that is the same, and of a model that was right, it is a change.
    for given, new in ((never_right, heavier), (made, more)):
        changed = changed_parameters(given, new, mechanism_of(made)).changed
        assert [row.name for row in changed] == ["m0"]


@pytest.mark.parametrize(("times", "of_given", "told"), [(3.0, 1.0, False), (3.0, 2.5, True)])
def test_what_is_missing_now_may_pass_for_a_change(
    made: Model, times: float, of_given: float, told: bool
):
    floor = {"force_error": 0.01}
    heavier = replace(
        made.with_values({"m0": made.values["m0"] + 6.0}),
        covariance=made.covariance,
        covariance_names=made.covariance_names,
        errors={"force_error": 0.01 * times, "noise_floor": floor},
    )
    given = replace(made, errors={"force_error": 0.01 * of_given, "noise_floor": floor})
    found = changed_parameters(given, heavier, mechanism_of(made))
    assert [row.name for row in found.changed] == (["m0"] if told else [])
    assert told or "3 times the noise floor" in found.reason


def test_a_platform_with_dry_friction_has_no_other_parameters_than_before(made: Model):
    plant = load_model("paper").with_effect("wheel_coulomb_friction", torque=0.3)
    log = record(plant, [multisine(np.random.default_rng(0), duration=20.0)], seed=3)[0]
    found = compare(made, [log]).changes
    assert found.sentences == [] and "these logs hold something" in found.reason


@pytest.mark.slow
def test_the_floor_of_a_model_that_lacks_much_is_that_of_its_own_logs():
    """No motion repeats in a multisine, and trees leave a tenth of so large a residual."""
    plant = load_model("paper").with_effect("floor_tilt", tilt_x=0.012, tilt_y=-0.006)
    plant = plant.with_effect("wheel_coulomb_friction", torque=0.2)
    motion = multisine(np.random.default_rng(0), duration=40.0)
    log = record(plant, [motion], seed=3)[0]
    truth = compare(plant, [log]).to_dict()["total"]
    made = identify(record(plant, [calibration()], seed=1)).model
    lacking = compare(made, [log]).to_dict()
    unknown = compare(replace(made, errors={}), [log]).to_dict()
    assert lacking["total"]["force_error"] > 10 * truth["force_error"]
    assert lacking["noise_floor"]["force_error"] < 1.5 * truth["force_error"]
    assert lacking["noise_floor"]["velocity_error"] < 2 * truth["velocity_error"]
    assert unknown["noise_floor"]["force_error"] > 3 * truth["force_error"]


@pytest.mark.slow
def test_a_load_on_real_contacts_is_told_as_mass():
    """No interval holds there, but what stretches say of each other is in the covariance."""
    pytest.importorskip("mujoco")
    from youbot_env.contact import ContactPlant

    plant = load_model("paper")
    loaded = plant.with_effect("payload_change", mass=5.0, x=0.1, y=0.03, time=0.0)
    before, same, after = (
        record(ContactPlant(model), [calibration()], seed=seed)
        for model, seed in ((plant, 1), (plant, 2), (loaded, 3))
    )
    made = identify(before).model
    assert compare(made, same).changes.sentences == []
    changed = {row.name: row for row in compare(made, after).changes.changed}
    risen = changed.get("m0") or changed["m0 + 4 I1/R^2"]
    assert risen.size == pytest.approx(5.0, abs=3 * risen.std)


@pytest.mark.slow
def test_a_model_without_deviations_is_not_tested():
    found = compare(load_model("paper"), [recording(seed=1)]).changes
    assert not found.rows and "no standard deviations" in found.reason


def test_logs_that_do_not_show_the_model_are_no_test(made: Model):
    found = compare(made, [recording(motion="III", seed=2)]).changes
    assert not found.rows and "do not show" in found.reason
