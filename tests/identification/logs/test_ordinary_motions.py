"""Steps, holding efforts, loads that drive, motions one way: ordinary, and no fault of a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from identification.logs.checks import check, limits_for
from identification.logs.findings import percent
from identification.logs.log import AXIS, Log
from tests.identification.recordings import recording

TIME = np.arange(0, 40, 0.01)
Array = np.ndarray


def axis_log(speed: Array, effort: Array, noise: float = 0.0) -> Log:
    rng = np.random.default_rng(0)
    speed = speed + noise * np.abs(speed).max() * rng.standard_normal(len(TIME))
    return Log("drive", AXIS, TIME, speed[:, None], effort[:, None])


def told(log: Log) -> list[str]:
    return [f"{f.level}: {f}" for f in check(log, limits_for(log, None, None, None))]


def there_and_back(time: Array) -> Array:
    return np.sin(0.9 * time) + 0.5 * np.sin(2.3 * time + 1)


def demanded(speed: Array, load: Array | float = 0.0) -> Array:
    return 0.5 * np.gradient(speed, TIME) + 0.3 * speed + 0.4 * np.tanh(speed / 0.01) + load


class TestSaturation:
    def test_a_channel_that_is_clipped_is_told(self):
        speed = there_and_back(TIME)
        log = axis_log(speed, np.clip(demanded(speed), -0.6, 0.6))
        assert any("stays at its extreme" in line for line in told(log))

    @pytest.mark.parametrize(
        "effort",
        [
            lambda t: np.where(t > 5, 2.0, 0.0),
            lambda t: np.where(np.sin(0.5 * t) > 0, 1.0, -1.0),
            lambda t: np.array([-1.0, 0.3, 1.0, -0.4, 0.7, 1.0, 0.1])[(t / 3).astype(int) % 7],
        ],
        ids=["step", "square wave", "levels"],
    )
    def test_commanded_steps_are_not(self, effort: Callable[[Array], Array]):
        torque = effort(TIME)
        speed = np.zeros(len(TIME))
        for k in range(1, len(TIME)):
            speed[k] = speed[k - 1] + 0.01 * (torque[k - 1] - 0.8 * speed[k - 1])
        assert not any("extreme" in line for line in told(axis_log(speed, torque, noise=0.005)))

    def test_a_small_effort_that_holds_a_joint_is_not(self):
        moves = np.sin(0.4 * TIME) > 0.3
        speed = np.where(moves, there_and_back(TIME) ** 2, 0.0)
        effort = np.where(moves, demanded(speed) + 0.5, -0.02)
        assert not any("extreme" in line for line in told(axis_log(speed, effort)))


class TestSigns:
    def test_a_wrong_sign_is_told(self):
        speed = there_and_back(TIME)
        (line,) = [x for x in told(axis_log(speed, -demanded(speed), 0.01)) if "sign" in x]
        assert line.startswith("error") and "multiply effort by -1" in line

    @pytest.mark.parametrize("load", [-3.0, 3.0])
    def test_a_weight_that_drives_down_fast_and_up_slowly_is_not(self, load: float):
        speed = there_and_back(TIME)
        # More way down than up: the load gives net power.
        speed = speed - np.sign(load) * 0.5
        log = axis_log(speed, demanded(speed, load), 0.01)
        assert not any(line.startswith("error") for line in told(log))

    def test_a_motion_one_way_blames_nothing(self):
        speed = 1.5 + there_and_back(TIME) ** 2
        lines = told(axis_log(speed, demanded(speed, load=-4.0), 0.01))
        assert not any(line.startswith("error") for line in lines)
        assert any("a load drives, or its sign is wrong" in line for line in lines)

    @pytest.mark.parametrize("wheel", range(4))
    def test_a_wheel_of_wrong_sign_is_told(self, wheel: int):
        log = recording(rate=50.0)
        turned = replace(log, effort=log.effort * np.where(np.arange(4) == wheel, -1.0, 1.0))
        assert any(line.startswith("error") and "sign" in line for line in told(turned))

    def test_a_platform_on_a_slope_is_sound(self):
        log = recording(effects=(("floor_tilt", (("tilt_x", 0.08), ("tilt_y", 0.0))),), rate=50.0)
        assert not any(line.startswith("error") for line in told(log))


class TestRest:
    """A speed that is zero for long, where noise is smaller than the last decimal."""

    @staticmethod
    def frozen(speed: Array) -> list[str]:
        log = recording()
        velocity = log.velocity.copy()
        velocity[: len(TIME), 0] = speed
        return [line for line in told(replace(log, velocity=velocity)) if "stands still" in line]

    @staticmethod
    def fine(time: Array) -> Array:
        noise = 1e-4 * np.random.default_rng(1).standard_normal(len(time))
        return 2.0 * there_and_back(time) + noise

    def test_a_wheel_that_starts_late_is_no_fault(self):
        speed = self.fine(np.maximum(TIME - 1.0, 0.0)) * np.minimum(np.maximum(TIME - 1.0, 0), 1)
        assert (speed[:100] == 0).all()
        assert self.frozen(speed) == []

    def test_a_sensor_that_falls_to_zero_in_mid_motion_is_one(self):
        speed = self.fine(TIME)
        speed[1000:1100] = 0.0
        assert len(self.frozen(speed)) == 1
        assert "error" in self.frozen(speed)[0]


@pytest.mark.parametrize(
    ("share", "words"),
    [
        *[(1.0, "100 %"), (0.9999, "100 %"), (0.995, "100 %"), (0.0123, "1.2 %"), (0.5, "50 %")],
        *[(2.5, "250 %"), (0.00012, "0.012 %"), (0.0, "0 %")],
    ],
)
def test_shares_are_plain_numbers(share: float, words: str):
    assert percent(share) == words
