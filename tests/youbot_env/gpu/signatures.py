"""PTX of both kernels, for a GPU of compute capability 9.0 that need not be there."""

from __future__ import annotations

from typing import Any

from numba import cuda as _cuda, types

from youbot_env.gpu import kernels
from youbot_env.gpu.device_code import DeviceModules, device_period
from youbot_env.gpu.operations import device, operations
from youbot_env.tracking import period_lanes as lanes
from youbot_env.tracking.batch import Batch
from youbot_env.tracking.options import tracking_setup

cuda: Any = _cuda  # its functions are made at run time


def ptx(dtype: str) -> dict[str, str]:
    """Text by name of a kernel."""
    setup = tracking_setup(wheel_speed_noise=0.01, randomise={"m0": ("90%", "110%")}, dtype=dtype)
    one = Batch(setup, 1, autoreset=lanes.SAME_STEP, reports=False, threads=1)
    period = device_period(one.structure, setup.single, DeviceModules(device, operations()))
    double, single, whole, short = types.float64, types.float32, types.int64, types.uint16
    real = single if setup.single else double
    number, row, cube = double[:, ::1], double[::1], double[:, :, ::1]
    shown = types.Tuple((single[:, ::1], row, types.boolean[:, ::1], number))
    block = (real[:, ::1], real[:, ::1], short[:, ::1], whole[:, ::1], single[:, ::1])
    rows = types.Tuple((*block, real[:, ::1], real[:, ::1], single[:, ::1]))
    fixed = types.Tuple((cube, real[::1], real[::1], whole[::1], whole[::1]))
    step = (single[:, ::1], shown, rows, fixed, whole)
    drawn = types.Tuple((types.UniTuple(number, 6), types.Tuple((*[number] * 4, single[:, ::1]))))
    groups = (
        types.UniTuple(single[:, ::1], 4),
        types.Tuple((cube, single[:, :, ::1])),
        types.Tuple((cube, number)),
        types.Tuple((types.uint32[:, :, ::1], *[number] * 3, *[whole[:, ::1]] * 2)),
        types.UniTuple(number, 3),
        types.UniTuple(number, 2),
        types.Tuple((short[:, ::1], real[:, ::1])),
    )
    begin = (shown, single[:, ::1], rows, fixed, drawn, real[::1], types.Tuple(groups), whole)
    made = {
        "step": (kernels.step_kernel(period), step),
        "begin": (kernels.begin_kernel(period), begin),
    }
    return {name: cuda.compile_ptx(f, of, cc=(9, 0))[0] for name, (f, of) in made.items()}
