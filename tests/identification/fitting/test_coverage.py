"""Monte Carlo over made-up platforms: a stated standard deviation must be the true one.

    python -m tests.identification.fitting.test_coverage 60 [SEED]

prints the same figures, by parameter and by rate, for as many platforms as one likes.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from controllers.kinematic import KinematicControl
from controllers.recording import SPEED_NOISE, TORQUE_NOISE, control_step, drive
from identification.fitting.least_squares import Fit, fit
from identification.logs.log import Log
from identification.mechanisms.mecanum import Mecanum
from youbot_env.model.model import BASE_UNITS, Estimate, Model
from youbot_env.motions.calibration import calibration
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.geometry import Geometry
from youbot_env.simulation.compiled import rollout

PLATFORMS = 60
RANGES = {
    "m0": (30.0, 40.0),
    "I0": (3.0, 5.5),
    "I1": (0.004, 0.0085),
    "aX": (-0.028, 0.028),
    "aY": (-0.028, 0.028),
    "mu1": (0.07, 0.15),
    "mu2": (0.003, 0.007),
}
RATES = (50.0, 100.0, 250.0)


@dataclass(frozen=True)
class Case:
    """One platform: rate and noise of its log, and (7,) error over std of each parameter."""

    rate: float
    noise: float
    deviation: NDArray[np.float64]


def random_platform(rng: np.random.Generator) -> Model:
    """A platform of the youBot's geometry with parameters drawn from RANGES."""
    drawn = {name: Estimate(rng.uniform(*RANGES[name]), unit) for name, unit in BASE_UNITS.items()}
    return Model(Geometry(), drawn)


def calibrate(model: Model, rate: float, noise: float, rng: np.random.Generator) -> Log:
    """Log of the calibration run at ``noise`` times the usual noise."""
    return drive(
        model,
        calibration(model.geometry),
        KinematicControl(model.geometry, sample_time=control_step(rate)),
        rate=rate,
        torque_noise=noise * TORQUE_NOISE,
        speed_noise=noise * SPEED_NOISE,
        rng=rng,
    )


def physical(found: Fit, model: Model) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (7,) in the order of BASE_UNITS, and their covariance propagated from theta's."""
    names = model.structure.parameter_names
    theta = dict(zip(names, found.theta, strict=True))
    mass = theta["m0"] - 4 * model.geometry.m1
    jacobian = np.zeros((len(BASE_UNITS), len(names)))
    values = np.empty(len(BASE_UNITS))
    for row, name in enumerate(BASE_UNITS):
        if name in ("aX", "aY"):
            moment = f"m_{name}"
            values[row] = theta[moment] / mass
            jacobian[row, names.index(moment)] = 1 / mass
            jacobian[row, names.index("m0")] = -values[row] / mass
        else:
            values[row] = theta[name]
            jacobian[row, names.index(name)] = 1.0
    return values, jacobian @ found.covariance @ jacobian.T


def one_case(seed: tuple[int, int]) -> Case:
    rng = np.random.default_rng(seed)
    model = random_platform(rng)
    rate, noise = float(rng.choice(RATES)), float(rng.uniform(0.5, 2.0))
    log = calibrate(model, rate, noise, rng)
    mechanism = Mecanum(model.geometry, model.structure)
    start = Model(Geometry(), {n: Estimate(sum(RANGES[n]) / 2, u) for n, u in BASE_UNITS.items()})
    found = fit(mechanism, [mechanism.samples(log)], start.theta)
    values, covariance = physical(found, model)
    truth = np.array([model.values[name] for name in BASE_UNITS])
    return Case(rate, noise, (values - truth) / np.sqrt(np.diag(covariance)))


def study(platforms: int, seed: int = 0) -> Iterator[Case]:
    """Cases of that many random platforms, on two processes."""
    rollout(
        Model(Geometry(), {n: Estimate(1e2, u) for n, u in BASE_UNITS.items()}).structure, dynamics
    )
    fork = multiprocessing.get_context("fork")  # the children find this module as it is
    with ProcessPoolExecutor(2, mp_context=fork) as pool:
        yield from pool.map(one_case, [(seed, k) for k in range(platforms)])


def inside(cases: list[Case]) -> float:
    """Share of intervals value +- 1.96 std that hold the truth."""
    return float(np.mean([np.abs(case.deviation) <= 1.96 for case in cases]))


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return list(study(PLATFORMS))


@pytest.mark.slow
class TestStatedUncertainty:
    def test_intervals_hold_the_truth_as_often_as_they_say(self, cases: list[Case]):
        assert 0.90 <= inside(cases) <= 0.99

    @pytest.mark.parametrize("rate", RATES)
    def test_they_do_at_every_rate(self, cases: list[Case], rate: float):
        # Some 20 platforms whose seven errors are correlated: a wider band than for all.
        assert 0.85 <= inside([case for case in cases if case.rate == rate]) <= 0.999

    @pytest.mark.parametrize("name", BASE_UNITS)
    def test_error_over_std_has_unit_size(self, cases: list[Case], name: str):
        deviation = np.array([case.deviation for case in cases])[:, list(BASE_UNITS).index(name)]
        assert 0.75 <= np.sqrt(np.mean(deviation**2)) <= 1.3

    @pytest.mark.parametrize("name", BASE_UNITS)
    def test_bias_is_small_beside_the_std(self, cases: list[Case], name: str):
        deviation = np.array([case.deviation for case in cases])[:, list(BASE_UNITS).index(name)]
        assert abs(deviation.mean()) <= 0.4, "three standard errors of a mean of 60"


def report(cases: list[Case]) -> None:
    """Print coverage, rms and mean of error over std, by rate and by parameter."""
    print("rate   cases  inside   " + "  ".join(f"{name:>13}" for name in BASE_UNITS))
    for rate in (*RATES, None):
        chosen = [case for case in cases if rate in (None, case.rate)]
        if chosen:
            deviation = np.array([case.deviation for case in chosen])
            rms, mean = np.sqrt((deviation**2).mean(axis=0)), deviation.mean(axis=0)
            share = (np.abs(deviation) <= 1.96).mean(axis=0)
            cells = [f"{s:.2f} {r:.2f} {m:+.2f}" for s, r, m in zip(share, rms, mean, strict=True)]
            print(f"{rate or 'all':>5} {len(chosen):6} {inside(chosen):7.3f}   " + "  ".join(cells))
    print("cells: share inside value +- 1.96 std, rms and mean of error / std")


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:3]]
    report(list(study(*numbers or [PLATFORMS])))
