"""A linear law that changes at an instant is seen; noise of no colour looks like one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.fitting.changing_laws import ChangingLaw, Rows, changing_law
from identification.fitting.settings import ChangingLawSettings

SETTINGS = ChangingLawSettings()
STEP = 0.05
DURATIONS = (60.0, 60.0)
LOG = np.repeat(np.arange(2), [round(each / STEP) for each in DURATIONS])
TIME = np.concatenate([STEP * np.arange(round(each / STEP)) for each in DURATIONS]).astype(float)
STRETCH = (LOG * 10 + TIME // 6.0).astype(int)
FOLD = np.random.default_rng(0).permutation(STRETCH.max() + 1)[STRETCH] % 6


def motion() -> np.ndarray:
    """Velocities and accelerations (n, 6) of a multisine in each log."""
    rng = np.random.default_rng(1)
    found = np.zeros((len(TIME), 6))
    for log in range(2):
        rates, phases = rng.uniform(0.3, 3.0, (3, 4)), rng.uniform(0.0, 6.3, (3, 4))
        turns = TIME[LOG == log, None, None] * rates + phases
        found[LOG == log, :3] = np.sin(turns).sum(axis=-1)
        found[LOG == log, 3:] = (rates * np.cos(turns)).sum(axis=-1)
    return found


SIGNALS = motion()
COLUMNS = np.zeros((len(TIME), 3, 6))
for _axis in range(3):  # a mass and a friction along each axis
    COLUMNS[:, _axis, _axis] = SIGNALS[:, _axis]
    COLUMNS[:, _axis, 3 + _axis] = SIGNALS[:, 3 + _axis]


def law_in(force: np.ndarray) -> ChangingLaw:
    """What is found in the residual of a fit to a force (n, 3)."""
    flat = COLUMNS.reshape(-1, 6)
    residual = force - (COLUMNS @ np.linalg.lstsq(flat, force.ravel(), rcond=None)[0])
    return changing_law(Rows(residual, COLUMNS, SIGNALS, TIME, LOG, STRETCH, FOLD), SETTINGS)


def is_seen(found: ChangingLaw) -> bool:
    return found.share > SETTINGS.min_share and found.p_value <= SETTINGS.max_p_value


def lasting(memory: float, rng: np.random.Generator) -> np.ndarray:
    keep = np.exp(-STEP / memory)
    return np.asarray(lfilter([1.0], [1.0, -keep], rng.standard_normal((len(TIME), 3)), axis=0))


def wave(period: float, rng: np.random.Generator) -> np.ndarray:
    """A wave in time, in each log with phases of its own, and little noise."""
    phases = rng.uniform(0.0, 2 * np.pi, (2, 3))[LOG]
    turns = 2 * np.pi * TIME[:, None] / period + phases
    return np.sin(turns) + 0.05 * rng.standard_normal(turns.shape)


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: rng.standard_normal((len(TIME), 3)),
        *(lambda rng, m=memory: lasting(m, rng) for memory in (0.1, 0.5, 2.0, 10.0)),
        *(lambda rng, p=period: wave(p, rng) for period in (10.0, 20.0, 45.0, 100.0)),
        lambda rng: np.cumsum(rng.standard_normal((len(TIME), 3)), axis=0),
    ],
)
def test_noise_of_any_colour_follows_no_law(make):
    rng = np.random.default_rng(2)
    assert not any(is_seen(law_in(make(rng))) for _ in range(10))


@pytest.mark.parametrize("late_in", [(0, 1), (0,), (1,)])
def test_a_mass_that_is_put_on_is_seen(late_in):
    rng = np.random.default_rng(3)
    late = (TIME > 30.0) & np.isin(LOG, late_in)
    force = 0.3 * late[:, None] * SIGNALS[:, 3:] + 0.05 * rng.standard_normal((len(TIME), 3))
    found = law_in(force)
    assert is_seen(found) and found.share > 0.3


def test_a_drive_that_grows_weak_is_seen_beside_an_offset_that_wanders():
    rng = np.random.default_rng(4)
    late = TIME > 22.0
    # A weak wheel turns the forces along one axis into forces along all.
    weak = 0.3 * late[:, None] * np.outer(SIGNALS[:, 1] + 0.4 * SIGNALS[:, 4], [1.0, -1.0, 0.3])
    found = law_in(weak + 0.5 * weak.std() * wave(45.0, rng))
    assert is_seen(found)
    assert not is_seen(law_in(0.5 * weak.std() * wave(45.0, rng)))


def test_what_happens_in_two_seconds_is_no_law():
    rng = np.random.default_rng(5)
    burst = 30.0 * ((TIME > 40.0) & (TIME < 42.0))[:, None] * SIGNALS[:, 3:]
    assert not is_seen(law_in(burst + rng.standard_normal(burst.shape)))


def test_less_than_two_stretches_tell_nothing():
    few = slice(0, 40)
    rows = Rows(
        *(SIGNALS[few, :3], COLUMNS[few], SIGNALS[few]),
        *(TIME[few], LOG[few], STRETCH[few], FOLD[few]),
    )
    found = changing_law(rows, SETTINGS)
    assert found.share == 0.0 and not found.predicted.any() and not is_seen(found)
