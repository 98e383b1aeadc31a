"""Kernels of a batch on a GPU: a control period of every row, and the start of episodes."""

from __future__ import annotations

from typing import Any

import numba.cuda as _cuda

from youbot_env.simulation.lane_layout import LANES
from youbot_env.tracking.period_lanes import (
    ACTIONS,
    BEGIN,
    CLOCK,
    EPISODE,
    KEY,
    PENDING,
    PREVIEW,
    RESETS,
    SAME_STEP,
)

cuda: Any = _cuda  # its functions are made at run time


def step_kernel(period: Any) -> Any:
    """The function ``step`` of a module of device functions, one thread a row."""
    take, move, finish, ends = period.take, period.move, period.finish, period.ends

    def step(action, shown, rows, fixed, tick):
        """One control period under actions (n, 4).

        shown : observations (D, n), rewards (n,), ends (2, n), reports (0 or n, W)
        rows, fixed : see ``GpuBatch``
        """
        row = cuda.grid(1)
        seen, reward, over, report = shown
        if row < reward.shape[0]:
            X, Y, Z, K, P, W, V, F = rows
            table, numbers, lengths, whole, plant = fixed
            b, i = row // LANES, row % LANES
            x, y, z, k, p = X[b, i:], Y[b, i:], Z[b, i:], K[b, i:], P[b, i:]
            w, v, f = W[b, i:], V[b, i:], F[b, i:]
            actions = 3 * (whole[PREVIEW] + 1)
            take(action, row, p, 1, actions, tick % whole[ACTIONS])
            move(x, p, w, 1, tick, actions, numbers, whole, lengths, plant)
            k[CLOCK * LANES] += 1
            finish(
                row, x, y, z, k, w, v, p, f, table, 1, tick, numbers, whole, lengths, plant,
                seen, reward, report,
            )  # fmt: skip
            ends(row, k, v, 1, whole, over, reward)

    return step


def begin_kernel(period: Any) -> Any:
    """The same of ``begin``: a thread for each of some workspaces, which takes rows in turn."""
    begin_row, finish = period.begin_row, period.finish

    def begin(shown, final, rows, fixed, drawn, start, spaces, tick):
        """Begin the episodes of those rows whose counters ask for one, and show their start.

        final : (D, n) gets the last observation of the episode before; (0, 0): nowhere
        drawn, start, spaces : see ``GpuBatch``
        """
        slot, slots = cuda.grid(1), cuda.gridsize(1)
        seen, reward, over, report = shown
        X, Y, Z, K, P, W, V, F = rows
        table, numbers, lengths, whole, plant = fixed
        models, wanted = drawn
        choose, own, sums, small, found, model, sine = spaces
        if slot >= choose[0].shape[0]:
            return
        space = (
            (choose[0][slot], choose[1][slot], choose[2][slot], choose[3][slot]),
            (own[0][slot], own[1][slot]),
            (sums[0][slot], sums[1][slot]),
            (
                *(small[0][slot], small[1][slot], small[2][slot], small[3][slot]),
                *(small[4][slot], small[5][slot]),
            ),
        )
        work = space, found[0][slot], found[1][slot], found[2][slot]
        model_work, sines = (model[0][slot], model[1][slot]), (sine[0][slot], sine[1][slot])
        row = slot
        while row < reward.shape[0]:
            b, i = row // LANES, row % LANES
            if K[b, PENDING * LANES + i] == BEGIN:
                x, y, z, k, p = X[b, i:], Y[b, i:], Z[b, i:], K[b, i:], P[b, i:]
                w, v, f = W[b, i:], V[b, i:], F[b, i:]
                for column in range(final.shape[0]):
                    final[column, row] = seen[column, row]
                begin_row(
                    x, y, z, k, p, w, v, table, start, tick, numbers, whole, lengths, plant,
                    models, wanted, work, model_work, sines,
                )  # fmt: skip
                earned = reward[row]
                finish(
                    row, x, y, z, k, w, v, p, f, table, 1, tick, numbers, whole, lengths, plant,
                    seen, reward, report,
                )  # fmt: skip
                # A start earns nothing: the reward is the last step's.
                reward[row] = earned if whole[RESETS] == SAME_STEP else 0.0
                k[PENDING * LANES] = 0
            row += slots

    return begin


def ask(K, chosen, keys):
    """Let rows that are chosen (n,) begin: the first episode of keys (n,), or the next one."""
    row = cuda.grid(1)
    if row < chosen.shape[0] and chosen[row]:
        b, i = row // LANES, row % LANES
        if keys.shape[0]:
            K[b, KEY * LANES + i] = keys[row]
            K[b, EPISODE * LANES + i] = 0
        else:
            K[b, EPISODE * LANES + i] += 1
        K[b, PENDING * LANES + i] = BEGIN
