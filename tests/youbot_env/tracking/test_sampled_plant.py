"""Between commands and measurements: counts over their window, noise, and delays of any length."""

from __future__ import annotations

import numpy as np
import pytest

from youbot_env.errors import InputError
from youbot_env.simulation.plant import Plant
from youbot_env.tracking.sampled_plant import SampledPlant
from youbot_env.tracking.sensors import Sensors

PERIOD, STEPS = 0.01, 40


def measured(sampled: SampledPlant, elapsed: int) -> tuple[np.ndarray, np.ndarray]:
    speed, twist = np.empty((1, 4)), np.empty((1, 3))
    sampled.measure(speed, twist, (0, 1), elapsed)
    return speed[0], twist[0]


@pytest.mark.parametrize("window", [1, 2, 5])
def test_counts_are_differenced_over_the_window(window: int):
    sensors = Sensors(encoder_ticks=4000, window=window)
    plant, rng = Plant(), np.random.default_rng(0)
    plant.reset(twist=(0.3, -0.2, 0.4))
    sampled = SampledPlant(plant, sensors, PERIOD, STEPS + 1)
    sampled.begin(0, np.zeros((STEPS + 1, 4)))
    one_count = sensors.resolution / (window * PERIOD)
    start, angles = plant.wheel_speed, [plant.wheel_angle]
    speed, _ = measured(sampled, 0)
    assert np.abs(speed - start).max() <= one_count, "as if it had been moving like this before"
    for k in range(1, STEPS + 1):
        sampled.apply(rng.uniform(-1, 1, (1, 4)))
        angles.append(plant.wheel_angle)
        speed, twist = measured(sampled, 1)
        if k >= window:
            counts = np.floor(np.array([angles[k], angles[k - window]]) / sensors.resolution)
            np.testing.assert_allclose(speed, (counts[0] - counts[1]) * one_count, atol=1e-12)
        np.testing.assert_allclose(twist, plant.geometry.body_twist(speed), atol=1e-12)


def test_noise_is_added_sample_by_sample():
    plant = Plant()
    sensors = Sensors(wheel_speed_noise=0.02)
    noise = sensors.noise(np.random.default_rng(1), STEPS + 1)
    assert noise.std() == pytest.approx(0.02, rel=0.2)
    sampled = SampledPlant(plant, sensors, PERIOD, STEPS + 1)
    sampled.begin(0, noise)
    for k in range(STEPS + 1):
        speed, _ = measured(sampled, int(k > 0))
        np.testing.assert_allclose(speed - plant.wheel_speed, noise[k], atol=1e-12)
        sampled.apply(np.ones((1, 4)))


def test_what_is_drawn_after_the_noise_does_not_depend_on_its_size():
    one, other = np.random.default_rng(0), np.random.default_rng(0)
    assert not Sensors(0.0).noise(one, 7).any()
    assert Sensors(0.1).noise(other, 7).any()
    assert one.random() == other.random()


@pytest.mark.parametrize("delay", [0.01, 0.013, 0.02])
def test_a_delay_of_the_loop_is_a_delay_of_the_plant(delay: float):
    late = Plant(Plant().models[0].with_effect("torque_delay", delay=delay))
    sampled = SampledPlant(plant := Plant(), Sensors(), PERIOD, STEPS + 1, delay)
    sampled.begin(0, np.zeros((STEPS + 1, 4)))
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        torque = rng.uniform(-1, 1, (1, 4))
        sampled.apply(torque)
        late.step(torque[0], PERIOD)
        np.testing.assert_allclose(plant.state[:10], late.state[:10], atol=1e-9)
        np.testing.assert_array_equal(sampled.delivered, late.acting_torque(torque))


@pytest.mark.parametrize("window", [0, -1, 1.5])
def test_a_window_is_whole_periods(window):
    with pytest.raises(InputError, match="window"):
        Sensors(window=window)
