"""Platforms that track references side by side on a GPU, all of a step in two kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba.cuda as _cuda
import numpy as np
from numpy.typing import NDArray

from youbot_env.errors import InputError
from youbot_env.gpu import kernels
from youbot_env.gpu.device_code import DeviceModules, device_period
from youbot_env.gpu.operations import device, operations
from youbot_env.simulation.lane_layout import LANES
from youbot_env.tracking import episode_draws, period_lanes as lanes
from youbot_env.tracking.batch import Batch, Shared, keys_of
from youbot_env.tracking.options import tracking_setup

cuda: Any = _cuda  # its functions are made at run time

THREADS = 2 * LANES
"""Threads of a block of threads: they work on two blocks of rows, and fill whole warps of 32."""

BEGINNERS = 1024
"""Episodes that begin at the same time, at most: each needs some 20 kB to draw its reference in."""


class GpuBatch:
    """``YouBotTracking-v0`` on a GPU: the same rows as a vector environment's, the same episodes.

    What an episode is follows from its key and number, as on the processor; results differ by what
    the two machines round differently. A row whose episode is over begins the next one within the
    step (``AutoresetMode.SAME_STEP``), with a new reference and a new model. Arrays stay on the
    GPU: they have ``__cuda_array_interface__``, so ``torch.as_tensor(array, device="cuda")`` shares
    their memory. A step writes over those of the last.

    Parameters
    ----------
    copies : rows
    dtype : "float32" or "float64" of the platforms
    options : those of ``YouBotTracking-v0``, see :func:`youbot_env.tracking.options.tracking_setup`

    Attributes
    ----------
    observation : (D, n) float32, a column for each copy: its transpose is the usual shape
    reward : (n,) float64, each in [0, 1]
    over : (2, n) bool: terminated, truncated
    final_observation : (D, n): of rows whose episode has just ended, their last observation

    Raises
    ------
    InputError
        If there is no GPU, or an option is wrong.
    """

    def __init__(self, copies: int, *, dtype: str = "float32", **options: Any) -> None:
        if copies < 1:
            raise InputError(f"gpu: copies must be at least 1, not {copies}")
        if not cuda.is_available():
            raise InputError(
                'gpu: no CUDA device is found; pip install "youbot[gpu]" on a machine with one, '
                "or use gymnasium.make_vec, which runs on the processor"
            )
        setup = tracking_setup(**options, dtype=dtype)
        if setup.contact is not None:
            raise InputError('gpu: plant "contact" runs on the processor alone')
        self.copies, self.setup = copies, setup
        # One row of the processor's, for the numbers that all rows share and the sizes of a block.
        one = Batch(setup, 1, autoreset=lanes.SAME_STEP, reports=False, threads=1)
        period = device_period(one.structure, setup.single, DeviceModules(device, operations()))
        self._step = cuda.jit(kernels.step_kernel(period))
        self._begin = cuda.jit(kernels.begin_kernel(period))
        self._ask = cuda.jit(kernels.ask)
        self._tick, self._has_keys = 0, False
        self._grid = -(-copies // THREADS), min(THREADS, copies)
        shared = one.shared()
        self._rows = tuple(cuda.to_device(array) for array in self._blocks(shared))
        self._fixed = tuple(cuda.to_device(array) for array in shared.fixed)
        self._drawn = tuple(tuple(map(cuda.to_device, group)) for group in shared.drawn)
        self._start = cuda.to_device(shared.start)
        self._spaces = tuple(
            tuple(cuda.to_device(array) for array in group) for group in self._workspaces(shared)
        )
        observed = setup.task.observation_size
        self.observation = cuda.to_device(np.zeros((observed, copies), np.float32))
        self.final_observation = cuda.to_device(np.zeros((observed, copies), np.float32))
        self.reward = cuda.to_device(np.zeros(copies))
        self.over = cuda.to_device(np.zeros((2, copies), np.bool_))
        self._report = cuda.to_device(np.zeros((0, lanes.REPORT_COLUMNS)))

    def _blocks(self, shared: Shared) -> list[NDArray[Any]]:
        """x, y, z, k, p of all rows, and what each thread works in: w, v, f."""
        count = -(-self.copies // LANES)
        found = [np.repeat(array, count, axis=0) for array in shared.blocks]
        widths = (shared.workspace, lanes.WORK)
        found += [np.zeros((count, width * LANES), self.setup.real) for width in widths]
        return [*found, np.zeros((count, 4 * LANES), np.float32)]

    def _workspaces(self, shared: Shared) -> list[list[NDArray[Any]]]:
        """What episodes are drawn in, an array each with a row for each beginner."""
        whole, real = shared.fixed[3], self.setup.real
        tones, points = int(whole[lanes.TONES]), int(whole[lanes.PEAK_POINTS])
        models, wanted = shared.drawn
        # Their shapes are those of the processor's, whose function Python cannot call: without a
        # compiler it can.
        draws = DeviceModules(lambda function: function, {}).shared(episode_draws.__name__)
        groups = list(draws.workspace(tones, points, len(wanted[3]) > 0))
        groups.append((np.zeros(3 * tones), np.zeros(3 * tones), np.zeros(3)))
        groups.append((np.zeros(models[1].shape[1]), np.zeros(models[2].shape[1])))
        groups.append((np.zeros(6 * tones, np.uint16), np.zeros(3 * tones, real)))
        many = min(BEGINNERS, self.copies)
        return [[np.repeat(array[None], many, axis=0) for array in group] for group in groups]

    def reset(self, seed: int | Sequence[int] | None = None) -> Any:
        """Begin an episode of every row; returns the observations.

        Parameters
        ----------
        seed : of the first row, and one more for each next one, or one for each; None: the next
            episodes, or of a machine's entropy where there were none
        """
        keys = np.zeros(0, np.int64)
        if seed is not None:
            seeds = range(seed, seed + self.copies) if isinstance(seed, int) else seed
            keys = keys_of(seeds)
        elif not self._has_keys:
            keys = np.random.SeedSequence().generate_state(self.copies, np.uint64).view(np.int64)
        if seed is not None and len(keys) != self.copies:
            raise InputError(f"gpu: {len(keys)} seeds for {self.copies} copies")
        self._has_keys = True
        chosen = cuda.to_device(np.ones(self.copies, np.bool_))
        self._ask[self._grid](self._rows[3], chosen, cuda.to_device(keys))
        self._begin_episodes()
        self.reward[:] = 0.0
        self.over[:] = False
        return self.observation

    def _shown(self) -> tuple[Any, ...]:
        return self.observation, self.reward, self.over, self._report

    def _begin_episodes(self) -> None:
        many = len(self._spaces[0][0])
        width = min(64, many)
        self._begin[-(-many // width), width](
            self._shown(),
            self.final_observation,
            *(self._rows, self._fixed, self._drawn, self._start, self._spaces, self._tick),
        )

    def step(self, action: Any) -> tuple[Any, Any, Any, Any]:
        """One control period.

        Parameters
        ----------
        action : (n, 4) float32 on the GPU, C-contiguous: torques over the limit, cut to [-1, 1]

        Returns
        -------
        observation (D, n), reward (n,), terminated (n,), truncated (n,)
        """
        action = (
            cuda.as_cuda_array(action)
            if hasattr(action, "__cuda_array_interface__")
            else (cuda.to_device(np.ascontiguousarray(action, np.float32)))
        )
        if action.shape != (self.copies, 4) or action.dtype != np.float32:
            raise InputError(
                f"gpu: actions must be ({self.copies}, 4) float32, "
                f"not {action.shape} {action.dtype}"
            )
        self._tick += 1
        self._step[self._grid](action, self._shown(), self._rows, self._fixed, self._tick)
        self._begin_episodes()
        return self.observation, self.reward, self.over[0], self.over[1]
