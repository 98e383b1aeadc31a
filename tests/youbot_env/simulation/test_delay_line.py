"""A delay line gives back what it was given, a delay later, and loses no instant of it."""

from __future__ import annotations

import numpy as np
import pytest

from youbot_env.simulation.delay_line import DelayLine


def acting_at(pieces: list[tuple[np.ndarray, float]], instants: np.ndarray) -> np.ndarray:
    """What acts at ``instants`` (m,) [s], from pieces that follow each other."""
    ends = np.cumsum([length for _, length in pieces])
    return np.array([pieces[k][0] for k in np.searchsorted(ends, instants)])


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.01, 0.03, 0.0237, 1.0])
def test_each_command_acts_a_delay_later(delay: float):
    rng = np.random.default_rng(0)
    commands, durations = rng.normal(size=(60, 3, 4)), rng.choice([0.01, 0.004, 0.025], 60)
    line, pieces = DelayLine(delay, (3, 4)), []
    for command, duration in zip(commands, durations, strict=True):
        passed = line.passed(command, float(duration))
        assert sum(length for _, length in passed) == pytest.approx(duration, rel=1e-12)
        np.testing.assert_array_equal(line.acting, passed[-1][0])
        pieces.extend(passed)
    starts = np.concatenate([[0.0], np.cumsum(durations)])
    instants = rng.uniform(0, starts[-1], 500)
    since = instants - delay
    sent = commands[np.searchsorted(starts, since).clip(1) - 1]
    sent[since < 0] = 0.0
    np.testing.assert_array_equal(acting_at(pieces, instants), sent)


@pytest.mark.parametrize("periods", [1, 3, 7])
def test_a_delay_of_whole_periods_cuts_no_period(periods: int):
    line = DelayLine(periods * 0.01)
    for k in range(1, 1000):
        ((torque, length),) = line.passed(np.full((1, 4), float(k)), 0.01)
        assert length == 0.01 and torque[0, 0] == max(k - periods, 0)


def test_a_cleared_platform_forgets_its_commands_alone():
    line, rng = DelayLine(0.015, (2, 4)), np.random.default_rng(1)
    twin = DelayLine(0.015, (2, 4))
    for k in range(10):
        if k == 5:
            handed_out = line.acting
            before = handed_out.copy()
            line.clear(1)
            np.testing.assert_array_equal(handed_out, before)
            np.testing.assert_array_equal(line.acting[1], np.zeros(4))
        command = rng.normal(size=(2, 4))
        one, other = line.passed(command, 0.01), twin.passed(command, 0.01)
        for (torque, length), (whole, same) in zip(one, other, strict=True):
            assert length == same
            np.testing.assert_array_equal(torque[0], whole[0])
        if k == 5:
            assert not one[0][0][1].any()


def test_no_array_is_handed_out_twice_or_written_into():
    line, command = DelayLine(0.03), np.ones((1, 4))
    found = [line.passed(command, 0.01)[0][0] for _ in range(3)]
    found[1] += 1.0
    line.clear(0)
    assert not found[0].any() and not found[2].any() and (command == 1.0).all()
