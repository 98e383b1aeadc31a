"""Intervals of lengths on random made platforms.

``python -m tests.identification.kinematics.test_coverage 300`` prints the share of intervals that
hold the truth.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

from identification.kinematics import estimate_kinematics
from tests.identification.kinematics.made_platforms import Made, made
from youbot_env.physics.geometry import Geometry

NAMES = ("R", "L", "delay", "frame_yaw", "lever_x", "lever_y")


def random_platform(rng: np.random.Generator) -> Made:
    """Slip up to 2 %, noise of the pose 2 mm."""
    return Made(
        geometry=Geometry(
            R=rng.uniform(0.03, 0.1), l=rng.uniform(0.1, 0.2), h=rng.uniform(0.15, 0.3)
        ),
        seconds=float(rng.choice([30, 60, 100])),
        rate=float(rng.choice([50, 100])),
        slip=rng.uniform(0, 0.02),
        slip_time=float(rng.choice([0.05, 0.2, 0.5, 1.0])),
        outliers=float(rng.choice([0, 0.01])),
        delay=rng.uniform(-0.02, 0.08),
        frame_yaw=rng.uniform(-0.2, 0.2),
        lever=(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)),
        speed_noise=float(rng.choice([0.005, 0.03])),
    )


def deviations(count: int, seed: int = 0) -> tuple[dict[str, list[float]], list[float]]:
    """Errors over standard deviations by name, and relative errors of R."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[float]] = {name: [] for name in NAMES}
    radius = []
    for k in range(count):
        what = random_platform(rng)
        result = estimate_kinematics([made(what, seed + 10_000 + k)], what.geometry)
        truth = (what.geometry.R, what.geometry.L, what.delay, what.frame_yaw, *what.lever)
        for name, value in zip(NAMES, truth, strict=True):
            length = result.parameters[name]
            if length.value is not None and length.std is not None:
                found[name].append((length.value - value) / length.std)
        radius.append((result.parameters["R"].value or np.nan) / what.geometry.R - 1)
    return found, radius


def shares(found: dict[str, list[float]]) -> dict[str, float]:
    """Share of intervals that hold the truth by name."""
    return {name: float(np.mean(np.abs(z) < 1.96)) for name, z in found.items()}


@pytest.mark.slow
def test_intervals_hold_and_the_radius_is_within_half_a_percent():
    found, radius = deviations(60)
    held = np.concatenate([np.abs(z) < 1.96 for z in found.values()])
    assert 0.92 < held.mean() < 0.985
    assert np.quantile(np.abs(radius), 0.95) < 0.005


def main() -> None:
    """Print the shares for so many platforms."""
    found, radius = deviations(int(sys.argv[1]), 1)
    for name, share in shares(found).items():
        print(f"{name:10} {100 * share:5.1f} % of {len(found[name])}")
    everything = np.concatenate([np.abs(z) < 1.96 for z in found.values()])
    print(f"{'all':10} {100 * everything.mean():5.1f} % of {len(everything)}")
    print(f"largest error of R {100 * np.abs(radius).max():.2f} %, 95 % below "
          f"{100 * np.quantile(np.abs(radius), 0.95):.2f} %")  # fmt: skip


if __name__ == "__main__":
    main()
