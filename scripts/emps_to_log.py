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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from identification.logs.log import Log

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


@dataclass(frozen=True)
class Run:
    """One run of the EMPS: time (N,) [s], position (N,) [m] as measured, force (N,) [N]."""

    time: Array
    position: Array
    force: Array

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def inside(self) -> slice:
        """The samples that are not at an edge."""
        edge = round(EDGE / self.dt)
        return slice(edge, len(self.time) - edge)

    def motion(self) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration (N,): filtered without delay, central differences."""
        from scipy.signal import butter, filtfilt

        # SciPy's frequency is relative to half the sample rate.
        coefficients: Any = butter(4, 2 * CUTOFF * self.dt)
        position = filtfilt(coefficients[0], coefficients[1], self.position)
        speed = np.gradient(position, self.dt)
        return position, speed, np.gradient(speed, self.dt)


def read_run(path: str | Path) -> Run:
    """A run from the authors' file.

    Raises
    ------
    InputError
        If it is not a MATLAB file with the fields t, qm and vir.
    """
    from scipy.io import loadmat

    from youbot_env.errors import InputError

    try:
        data: dict[str, Any] = loadmat(path)
    except (OSError, ValueError, NotImplementedError) as error:
        raise InputError(f"{path}: cannot be read as a MATLAB file: {error}") from None
    for name in ("t", "qm", "vir"):
        if name not in data:
            raise InputError(f"{path}: {name!r} is missing; is it DATA_EMPS.mat?")
    gain = float(data["gtau"].squeeze()) if "gtau" in data else DRIVE_GAIN
    time, position, voltage = (data[name].ravel().astype(float) for name in ("t", "qm", "vir"))
    return Run(time, position, gain * voltage)


def log_of(run: Run, name: str) -> Log:
    """The run as a log of one axis: m, m/s, N."""
    from identification.logs.log import AXIS, Log

    position, speed, _ = run.motion()
    velocity, effort, position = (x[run.inside, None] for x in (speed, run.force, position))
    return Log(name, AXIS, run.time[run.inside], velocity, effort, position)


def relative_force_error(run: Run, force: Array) -> float:
    """The authors' error: norm(measured - predicted) / norm(measured), decimated, 0 ... 1.

    No filter a_f, unlike the force error of `youbot compare`. Their preprocessing: both forces go
    through a zero-phase Chebyshev filter ahead of the decimation.

    Parameters
    ----------
    force : (N,) what a model demands for the run's motion [N]
    """
    from scipy.signal import decimate

    measured, predicted = (
        decimate(x[run.inside], DECIMATION, zero_phase=True) for x in (run.force, force)
    )
    return float(np.linalg.norm(measured - predicted) / np.linalg.norm(measured))


def force_of_model(run: Run, model: Any) -> Array:
    """(N,) force that an axis' model demands for a run's motion [N].

    Parameters
    ----------
    model : an AxisModel in m, m/s, N
    """
    from youbot_env.physics.inverse_dynamics import acting_torque
    from youbot_env.physics.mechanism import Instant

    position, speed, acceleration = run.motion()
    at = Instant((speed,), (acceleration,), (position,), time=run.time - run.time[0])
    return acting_torque(np, model.structure, model.geometry, model.theta, at)[0]


def official_model() -> Any:
    """The authors' model as an AxisModel; their sign(v) is smoothed over 10 um/s."""
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
    from youbot_env.errors import InputError

    try:
        run = read_run(args.data)
        write_log(args.log, log_of(run, log_name(args.log)), decimals=9)
        print(f"{args.log}: {len(run.time)} samples at {1 / run.dt:.0f} Hz, m, m/s, N")
        if args.model:
            _print_errors(run, args.model)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _print_errors(run: Run, path: str) -> None:
    from identification.mechanisms.registry import load_any_model

    for name, model in (("official", official_model()), (path, load_any_model(path))):
        error = relative_force_error(run, force_of_model(run, model))
        print(f"relative force error of {name}: {100 * error:.2f} %")


if __name__ == "__main__":
    sys.exit(main())
