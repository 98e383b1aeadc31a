"""Turn measurements of the EMPS into logs, and compute the error that its authors publish.

The Electro-Mechanical Positioning System (Janot, Gautier, Brunot: Data set and reference models of
EMPS, Workshop on Nonlinear System Identification Benchmarks, 2019) is one axis that slides. Its
data may not be passed on with this package; fetch DATA_EMPS.mat from the benchmark's site, then

    python scripts/emps_to_log.py DATA_EMPS.mat emps.csv
    youbot identify emps.csv --mechanism axis --unit m -o emps.json
    youbot compare emps.json emps.csv

Its second run (DATA_EMPS_PULSES.mat) has the same fields.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from identification.logs.log import Log
    from identification.mechanisms.registry import AnyModel

Array = NDArray[np.float64]

DRIVE_GAIN = 35.15
"""gtau [N/V]: force of the motor per volt of the controller's output."""

CUTOFF = 100.0
"""Cut-off [Hz] of the zero-phase Butterworth filter, of order 4 each way, on the position."""

EDGE = 2.0 / CUTOFF
"""Seconds left out at each end, where filter and differences have samples on one side only."""

DECIMATION = 10
"""Of the 1 kHz data, after a low-pass filter, as the authors do."""

OFFICIAL = {"inertia": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
"""The authors' parameters [kg, N s/m, N, N]."""


def read_run(path: str | Path, name: str = "emps") -> Log:
    """A run from the authors' file as the log of one axis: m, m/s, N.

    Their preprocessing: the position is filtered without delay, its speed by central differences.

    Raises
    ------
    InputError
        If it is not a MATLAB file with the fields t, qm and vir.
    """
    from scipy.io import loadmat
    from scipy.signal import butter, filtfilt

    from identification.logs.log import AXIS, Log
    from youbot_env.errors import InputError

    try:
        data: dict[str, Any] = loadmat(path)
    except (OSError, ValueError, NotImplementedError) as error:
        raise InputError(f"{path}: cannot be read as a MATLAB file: {error}") from None
    for field in ("t", "qm", "vir"):
        if field not in data:
            raise InputError(f"{path}: {field!r} is missing; is it DATA_EMPS.mat?")
    gain = float(data["gtau"].squeeze()) if "gtau" in data else DRIVE_GAIN
    time, position, voltage = (data[field].ravel().astype(float) for field in ("t", "qm", "vir"))
    dt = (time[-1] - time[0]) / (len(time) - 1)
    # SciPy's frequency is relative to half the sample rate.
    coefficients: Any = butter(4, 2 * CUTOFF * dt)
    position = filtfilt(coefficients[0], coefficients[1], position)
    edge = round(EDGE / dt)
    inside = slice(edge, len(time) - edge)
    channels = (np.gradient(position, dt), gain * voltage, position)
    return Log(name, AXIS, time[inside], *(values[inside, None] for values in channels))


def force_of_model(log: Log, model: AnyModel) -> Array:
    """(N,) effort [N] that a model of the axis demands for a log's motion, at its samples.

    Delay and lag included: the package's own, of which its force error is made.
    """
    from identification.mechanisms.registry import mechanism_of

    mechanism = mechanism_of(model)
    start, end = mechanism.demand(model.theta, mechanism.samples(log)).force
    # The acceleration may jump at a sample, and the force with it: the mean of both sides.
    return np.concatenate([start[:1], 0.5 * (end[:-1] + start[1:]), end[-1:]])[:, 0]


def relative_force_error(log: Log, model: AnyModel) -> float:
    """The authors' error: norm(measured - predicted) / norm(measured), decimated, 0 ... 1.

    No filter a_f, unlike the force error of `youbot compare`. Their preprocessing: both forces go
    through a zero-phase Chebyshev filter ahead of the decimation.
    """
    from scipy.signal import decimate

    forces = (log.effort[:, 0], force_of_model(log, model))
    measured, predicted = (decimate(force, DECIMATION, zero_phase=True) for force in forces)
    return float(np.linalg.norm(measured - predicted) / np.linalg.norm(measured))


def official_model() -> AnyModel:
    """The authors' model; their sign(v) is smoothed over 10 um/s."""
    from identification.mechanisms.axis_model import axis_from_dict

    units = {"inertia": "kg", "viscous": "N s/m", "coulomb": "N", "offset": "N"}
    entries = {name: {"value": value, "unit": units[name]} for name, value in OFFICIAL.items()}
    scales = {"unit": "m", "speed": 0.0882, "acceleration": 0.33, "force": 54.1, "travel": 0.246}
    entries["smoothing"] = {"value": 1e-5, "unit": "m/s"}
    content = {"schema_version": 1, "mechanism": "axis", "scales": scales, "parameters": entries}
    return axis_from_dict(content, "official EMPS model")


def main() -> int:
    """Command line: see the module's docstring."""
    parser = argparse.ArgumentParser(description="Turn DATA_EMPS.mat into the log of one axis.")
    parser.add_argument("data", metavar="DATA_EMPS.mat")
    parser.add_argument("log", help="the log to write: .csv, .csv.gz or .parquet")
    parser.add_argument("--model", help="also print the official error of this model file")
    args = parser.parse_args()
    from identification.logs.reading import log_name, write_log
    from identification.mechanisms.registry import kind, kind_of, load_any_model
    from youbot_env.errors import InputError

    try:
        log = read_run(args.data, log_name(args.log))
        models = {"official": official_model()}
        if args.model:
            models[args.model] = model = load_any_model(args.model)
            if kind_of(model) is not kind("axis"):
                raise InputError(f"{args.model}: not the model of an axis")
        write_log(args.log, log, decimals=9)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{args.log}: {len(log.time)} samples at {1 / log.dt:.0f} Hz, m, m/s, N")
    for name, model in models.items() if args.model else ():
        error = relative_force_error(log, model)
        print(f"relative force error of {name}: {100 * error:.2f} %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
