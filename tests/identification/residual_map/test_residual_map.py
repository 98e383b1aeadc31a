"""A planted force is found under the variable that it depends on, and nothing where nothing is.

A force is planted by adding the wheel torques that it would have taken to those of a sound log:
the motion stays, so one recording serves for every kind of force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from controllers.recording import record
from identification.fitting.identify import identify
from identification.fitting.least_squares import fit
from identification.logs.reading import read_log
from identification.logs.wheel_checks import slip_of
from identification.mechanisms.mecanum import Mecanum
from identification.mechanisms.samples import Samples, cut
from identification.residual_map.residual_map import residual_map
from identification.residual_map.settings import ResidualMapSettings
from identification.residual_map.shares import ResidualMap, Share
from tests.identification.recordings import recording
from tests.identification.shared_data import DATA, needs_data
from tests.sparing import mostly_slow
from youbot_env.model.model_file import load_model
from youbot_env.motions.multisine import multisine
from youbot_env.physics.geometry import Geometry

PAPER = load_model("paper")
GEOMETRY = Geometry()
MECHANISM = Mecanum(GEOMETRY, PAPER.structure)
Force = Callable[[Samples], np.ndarray]


@cache
def sound() -> tuple[Samples, ...]:
    """Three logs of the paper's platform at 100 Hz, 260 s in all."""
    motions = [multisine(np.random.default_rng(seed), name=f"m{seed}") for seed in (4, 5)]
    logs = [recording(), *record(PAPER, motions, rate=100.0, seed=1)]
    return tuple(MECHANISM.samples(log) for log in logs)


@cache
def map_of(force: Force | None) -> ResidualMap:
    logs = sound() if force is None else tuple(planted(log, force) for log in sound())
    return residual_map(MECHANISM, PAPER.theta, logs)


def planted(samples: Samples, force: Force) -> Samples:
    return replace(samples, torque=samples.torque + GEOMETRY.wheel_torque(force(samples)))


def in_world(samples: Samples, fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
    """A force along the world's axes as a body force."""
    c, s = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2])
    return np.column_stack([c * fx + s * fy, c * fy - s * fx, 0 * fx])


def slope(samples: Samples) -> np.ndarray:
    still = np.ones(len(samples))
    return in_world(samples, 4.0 * still, 2.0 * still)


def nap(samples: Samples) -> np.ndarray:
    """Dry force of 10 N against motion along one world direction: in no catalogue."""
    c, s = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2])
    vx, vy = samples.twist[:, 0], samples.twist[:, 1]
    along = np.array([np.cos(2.3), np.sin(2.3)])
    speed = (c * vx - s * vy) * along[0] + (s * vx + c * vy) * along[1]
    return in_world(samples, *(10.0 * np.tanh(speed / 0.02) * along[:, None]))


def wall(samples: Samples) -> np.ndarray:
    """Spring of 8 N/m along the world's X axis alone."""
    return in_world(samples, 8.0 * (samples.pose[:, 0] - 0.3), np.zeros(len(samples)))


def saddle(samples: Samples) -> np.ndarray:
    """Each log lies elsewhere on it: what one shows of it says little of another."""
    x, y = samples.pose[:, 0], samples.pose[:, 1]
    return in_world(samples, 8.0 * y, 8.0 * x)


def ripple(samples: Samples) -> np.ndarray:
    return GEOMETRY.body_force(0.2 * np.sin(19 * samples.wheel_angle + 0.4))


def dry(samples: Samples) -> np.ndarray:
    return GEOMETRY.body_force(0.2 * np.tanh(samples.wheel_speed / 0.03))


def cubic(samples: Samples) -> np.ndarray:
    vx, vy, wz = samples.twist.T
    return np.column_stack([200 * vx * vy, 200 * vx**2, 10 * wz**3])


def warming(samples: Samples) -> np.ndarray:
    return GEOMETRY.body_force(0.05 * samples.wheel_speed * np.exp(-samples.time / 30)[:, None])


def beyond_twist(found: ResidualMap) -> list[str]:
    return [variable for variable in found.leading if variable != "twist"]


def test_a_sound_model_leaves_nothing_to_explain():
    found = map_of(None)
    assert found.leading == ()
    assert all(share.share == 0.0 for share in found.shares)
    assert abs(found.refit) < 0.05


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_of_the_speeds_that_accelerations_share_explains_nothing(seed: int):
    """A difference over two samples has less noise than the model's own, and seemed to explain."""
    log = recording(noise=0.0)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(log.velocity.shape)
    samples = [MECHANISM.samples(replace(log, velocity=log.velocity + noise))]
    found = residual_map(MECHANISM, fit(MECHANISM, samples, PAPER.theta).theta, samples)
    (yaw,) = (share for share in found.shares if share.variable == "acceleration_yaw")
    assert yaw.p_value > 0.05


@pytest.mark.parametrize("rate", mostly_slow([50.0, 250.0], [50.0]))
@pytest.mark.parametrize("noise", mostly_slow([0.5, 2.0], [2.0]))
def test_nor_at_other_rates_and_noise(rate: float, noise: float):
    logs = [MECHANISM.samples(recording("I", rate=rate, noise=noise, seed=k)) for k in (1, 2)]
    assert residual_map(MECHANISM, PAPER.theta, logs).leading == ()


@pytest.mark.parametrize(
    ("rate", "lag"), mostly_slow([(50.0, 0.03), (100.0, 0.1)], [(50.0, 0.03)], several=True)
)
def test_nor_does_a_model_that_knows_its_drives(rate: float, lag: float):
    """The rate of a demand behind a lag needs no filter of its own."""
    planted = (("actuator_lag", (("time_constant", lag),)),)
    logs = [recording("calibration", planted, rate=rate, seed=k) for k in (1, 2)]
    start = PAPER.with_effect("actuator_lag")
    found = identify(logs, start=start, recursive=False)
    assert found.model.values["actuator_lag.time_constant"] == pytest.approx(lag, rel=0.02)
    assert residual_map(found.mechanism, found.fit.theta, found.samples).leading == ()


@pytest.mark.parametrize(
    ("force", "variable"),
    [
        (slope, "heading"),
        (nap, "heading"),
        (wall, "position_x"),
        (saddle, "position_"),
        (ripple, "wheel_angle_"),
        (warming, "time"),
    ],
)
def test_the_variable_that_carries_a_force_leads_beyond_the_twist(force: Force, variable: str):
    found = map_of(force)
    assert beyond_twist(found)[0].startswith(variable)
    shares = {share.variable: share.share for share in found.shares}
    leader = max(value for name, value in shares.items() if name.startswith(variable))
    assert leader > 0.05


@pytest.mark.parametrize("force", [dry, cubic])
def test_a_function_of_the_twist_is_the_twist_s_alone(force: Force):
    found = map_of(force)
    assert found.leading[0] == "twist"
    assert found.shares[0].share > 0.9
    # The twist leaves 0.4 and 3 %: no other variable can have more.
    assert all(share.share < 0.04 for share in found.shares[1:])


def test_a_wheel_s_ripple_is_told_with_its_order():
    cycles = {
        share.variable: share.cycles for share in map_of(ripple).shares if share.cycles is not None
    }
    assert cycles == {f"wheel_angle_{wheel}": 19 for wheel in ("fl", "fr", "bl", "br")}


def test_one_wheel_s_ripple_is_that_wheel_s():
    def one(samples: Samples) -> np.ndarray:
        torque = np.zeros((len(samples), 4))
        torque[:, 2] = 0.2 * np.sin(5 * samples.wheel_angle[:, 2])
        return GEOMETRY.body_force(torque)

    first, *others = map_of(one).shares
    assert (first.variable, first.cycles) == ("wheel_angle_bl", 5)
    assert first.share > 5 * max(share.share for share in others)


def test_one_wheel_that_rubs_over_a_part_of_its_turn_is_that_wheel_s():
    def rubs(samples: Samples) -> np.ndarray:
        torque, angle = np.zeros((len(samples), 4)), samples.wheel_angle[:, 2]
        sign = np.tanh(samples.wheel_speed[:, 2] / 0.03)
        torque[:, 2] = 0.3 * np.maximum(np.cos(angle - 1.0), 0.0) * sign
        return GEOMETRY.body_force(torque)

    found = map_of(rubs)
    assert beyond_twist(found)[0] == "wheel_angle_bl"
    assert next(s.cycles for s in found.shares if s.variable == "wheel_angle_bl") == 1


def test_of_what_the_twist_explains_the_wheel_that_does_it_by_itself_comes_next():
    def one_way(samples: Samples) -> np.ndarray:
        torque = np.zeros((len(samples), 4))
        torque[:, 1] = 0.3 * np.maximum(np.tanh(samples.wheel_speed[:, 1] / 0.03), 0.0)
        return GEOMETRY.body_force(torque)

    first, second, *others = map_of(one_way).shares
    assert first.variable == "twist" and first.share > 0.9
    assert second.variable == "wheel_speed_fr" and second.share < 0.05 and second.alone > 0.9
    assert max(item.alone for item in others) < 0.9 * second.alone
    assert second.to_dict()["alone"] == second.alone and "alone" not in first.to_dict()


def test_what_a_rule_or_a_law_says_orders_variables_without_a_share():
    found = map_of(None).led_by(("position_",))
    assert {item.variable for item in found.shares[:2]} == {"position_x", "position_y"}
    likely = replace(
        found, shares=(Share("time", 0.5, 0.008), Share("heading", 0.0, 0.02, likely=0.6))
    )
    assert [s.share for s in likely.led_by(("heading",)).shares] == [0.6, 0.5]
    assert [s.share for s in likely.led_by(("position_",)).shares] == [0.5, 0.0]
    led = map_of(slope).led_by(("position_",))
    assert led.shares[0].variable == map_of(slope).shares[0].variable


def test_a_late_torque_shows_in_the_accelerations():
    """A motor that follows 80 ms late takes torque ahead of the motion: the rate of a demand."""
    late = []
    for samples in sound():
        shift = round(0.08 / samples.dt)
        moved = {
            name: getattr(samples, name)[:-shift]
            for name in ("time", "twist", "pose", "wheel_angle", "wheel_speed")
        }
        late.append(replace(samples, **moved, torque=samples.torque[shift:]))
    found = residual_map(MECHANISM, PAPER.theta, late)
    assert found.leading[0].startswith(("acceleration_", "torque_"))
    assert any(name.startswith("acceleration_") for name in found.leading[:2])


def test_what_the_model_s_parameters_could_absorb_is_not_counted():
    """Wrong parameters leave a large residual, all of which a refit removes."""
    found = residual_map(MECHANISM, 1.2 * PAPER.theta, sound())
    assert found.leading == ()
    assert found.refit > 0.9


def test_one_log_alone_is_held_out_in_blocks():
    found = residual_map(MECHANISM, PAPER.theta, [planted(sound()[0], nap)])
    assert beyond_twist(found)[0] == "heading"


def test_list_is_as_the_design_fixes_it():
    rows = map_of(nap).to_list()
    assert {row["variable"] for row in rows} == {
        "twist", "heading", "position_x", "position_y", "time", "log", "shared_time",
        *(f"{kind}_{wheel}" for kind in ("wheel_speed", "wheel_angle", "torque")
          for wheel in ("fl", "fr", "bl", "br")),
        *(f"acceleration_{axis}" for axis in ("x", "y", "yaw")),
    }  # fmt: skip
    shares = [row["share"] for row in rows]
    assert shares == sorted(shares, reverse=True)
    least = ResidualMapSettings().min_share_of_residual
    assert all(share == 0 or least < share <= 1 for share in shares)
    assert all(0 < row["p_value"] <= 1 for row in rows)


def test_same_seed_gives_the_same_numbers_to_the_bit():
    logs = [planted(log, nap) for log in sound()]
    assert residual_map(MECHANISM, PAPER.theta, logs).to_list() == map_of(nap).to_list()


def test_logs_too_short_to_tell_give_an_empty_map():
    found = residual_map(MECHANISM, PAPER.theta, [cut(sound()[0], 0, 1200)])
    assert found.to_list() == []
    assert found.leading == ()


def test_curve_of_a_ripple_is_the_ripple():
    (curve,) = map_of(ripple).curve("wheel_angle_fl")
    assert curve.unit == "rad" and "19 times a turn" in curve.label
    # 0.2 N m at the wheel are 0.2 L/R on the axis of L F_X.
    expected = 0.2 * GEOMETRY.L / GEOMETRY.R * np.sin(19 * curve.at + 0.4)
    assert np.corrcoef(curve.force[:, 0], expected)[0, 1] > 0.75
    assert curve.force[:, 0].std() == pytest.approx(expected.std(), rel=0.35)


def test_curve_of_a_slope_turns_with_the_heading_within_its_errors():
    """What is left beyond the twist: the slope's force less what seemed constant in the body."""
    (curve,) = map_of(slope).curve("heading")
    seen = np.isfinite(curve.force).all(axis=1)
    force = GEOMETRY.L * (4 * np.cos(curve.at) + 2 * np.sin(curve.at))
    assert np.corrcoef(curve.force[seen, 0], force[seen])[0, 1] > 0.7
    assert (curve.std[seen] > 0).all()


def test_curves_of_the_twist_are_one_for_each_component():
    curves = map_of(cubic).curve("twist")
    assert [curve.label for curve in curves] == ["VX", "VY", "W"]
    yaw = curves[2]
    # The model's friction absorbs the straight part of the cube, so compare bends.
    bend = np.polyfit(yaw.at, yaw.force[:, 2], 3)[0]
    assert bend == pytest.approx(10.0, rel=0.2)


def test_a_curve_that_is_not_there():
    with pytest.raises(KeyError, match="colour"):
        map_of(nap).curve("colour")


def test_no_slip_identity_holds_within_noise_and_fails_with_a_slipping_wheel():
    log = recording("I")
    slip = slip_of(log)
    assert slip is not None and not slip.exceeds_noise
    assert slip.ratio == pytest.approx(slip.noise, rel=0.1)
    velocity = log.velocity.copy()
    velocity[:, 1] *= 1.05
    slipping = slip_of(replace(log, velocity=velocity))
    assert slipping is not None and slipping.exceeds_noise


@pytest.mark.slow
@needs_data
@pytest.mark.parametrize(
    ("folder", "leader"),
    [("floor_tilt", "heading"), ("unknown_carpet_nap", "heading"),
     ("torque_ripple", "wheel_angle_"), ("actuator_lag", "acceleration_"),
     ("nominal_2", None)],
)  # fmt: skip
def test_on_logs_of_another_simulator(folder: str, leader: str | None):
    logs = [read_log(path) for path in sorted((DATA / folder).glob("*.csv"))]
    model = identify(logs, recursive=False).model
    found = residual_map(MECHANISM, model.theta, [MECHANISM.samples(log) for log in logs])
    if leader is None:
        assert found.leading == ()
    else:
        assert beyond_twist(found)[0].startswith(leader)
