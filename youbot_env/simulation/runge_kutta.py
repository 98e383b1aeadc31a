"""The classical Runge-Kutta method over a compiled derivative that is called by its address.

The same for all mechanisms and effects, so it is compiled once on a machine. ``code`` holds the
addresses of two functions and a count: the first fills so many numbers from (lengths, theta), what
does not change while a model moves; the second fills rates, from (state, factor, slope, torque,
those numbers), at ``state`` + ``factor`` ``slope``.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_calls import call_known, call_rates, copied
from youbot_env.simulation.lane_math import given, put


@njit(cache=True, inner=True, error_model="numpy")
def _step(rates, state, torque, end, dt, known, work):
    """One step with the torque going linearly from ``torque`` to ``end``; ``state`` moves on."""
    a, b, c, d, middle, nothing = work[0], work[1], work[2], work[3], work[4], work[5]
    # The torque is linear in the step, so its middle is the mean of its ends.
    for i in range(len(torque)):
        put(middle, i, 0.5 * (given(torque, i) + given(end, i)))
    call_rates(rates, state, 1.0, nothing, torque, known, a)
    call_rates(rates, state, 0.5 * dt, a, middle, known, b)
    call_rates(rates, state, 0.5 * dt, b, middle, known, c)
    call_rates(rates, state, dt, c, end, known, d)
    for i in range(len(state)):
        slope = given(a, i) + 2.0 * (given(b, i) + given(c, i)) + given(d, i)
        put(state, i, given(state, i) + dt / 6.0 * slope)


@njit(cache=True, inner=True, error_model="numpy")
def _workspace(size):
    """(6, size); the last row holds numbers that change none to which they are added."""
    work = np.empty((6, size))
    for i in range(size):
        work[5, i] = -0.0
    return work


@njit(cache=True, error_model="numpy", nogil=True)
def rollout(code, start, torque, duration, lengths, theta, substeps, out):
    """See ``compiled.rollout``. Other threads run meanwhile: a long log takes a second."""
    size, inputs = start.shape[0], torque.shape[1]
    work = _workspace(max(size, inputs))
    now, own, length = np.empty(size), np.empty(len(theta)), np.empty(len(lengths))
    first, last, known = np.empty(inputs), np.empty(inputs), np.empty(code[2])
    copied(start, now)
    copied(lengths, length)
    copied(theta, own)
    call_known(code[0], length, own, known)
    copied(now, out[0])
    part = 1.0 / substeps
    for k in range(torque.shape[0] - 1):
        dt = duration[k] * part
        for j in range(substeps):
            # From j / n to (j + 1) / n of the interval.
            for i in range(inputs):
                change = torque[k + 1, i] - torque[k, i]
                first[i] = torque[k, i] + change * (j * part)
                last[i] = torque[k, i] + change * ((j + 1) * part)
            _step(code[1], now, first, last, dt, known, work)
        copied(now, out[k + 1])


@njit(cache=True, error_model="numpy")
def derivative(code, state, torque, lengths, theta, found):
    """Rates of a state into ``found``; all arrays are contiguous."""
    known, nothing = np.empty(code[2]), _workspace(len(state))[5]
    call_known(code[0], lengths, theta, known)
    call_rates(code[1], state, 1.0, nothing, torque, known, found)
