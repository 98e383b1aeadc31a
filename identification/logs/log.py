"""A log: uniformly sampled measurements of a mechanism's joints."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification.logs.findings import Finding, grouped
from identification.signals.noise import NoiseSettings, white_noise
from youbot_env.errors import InputError

AXIS = ("",)
"""The joints of a one-axis mechanism: one, whose columns have no suffix."""


@dataclass(frozen=True, eq=False)
class Log:
    """Uniformly sampled measurements of n instants and k joints.

    Attributes
    ----------
    name : stem of the file
    joints : (k,) names, in the order of the columns; WHEELS, or AXIS for a one-axis mechanism
    time : (n,) [s], increasing; its origin is arbitrary, and its steps carry the rounding of the
        file, so computations take `dt`
    velocity : (n, k) [rad/s]; of one axis also [m/s]
    effort : (n, k) [N m]; of one axis also [N]
    position : (n, k) [rad] or [m], command : (n, k) commanded effort, or None
    pose : (n, 3) x, y [m] and yaw [rad] in the world, yaw unwrapped; or None
    gyro_z : (n,) yaw rate [rad/s], or None
    source : path of the file, "" if made in memory
    sha256 : hash of the file's bytes, "" if made in memory
    findings : what the checks found
    valid : (n,) False where velocity or effort was interpolated by a repair
    rows : (n,) line of the file that each sample comes from
    file_time : (rows of the file,) time column as it stands, repairs or not
    noise_settings : how `speed_noise` is measured

    All arrays are read-only.

    Raises
    ------
    InputError
        If a shape does not fit, a value is not finite or time does not increase.
    """

    name: str
    joints: tuple[str, ...]
    time: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    position: NDArray[np.float64] | None = None
    command: NDArray[np.float64] | None = None
    pose: NDArray[np.float64] | None = None
    gyro_z: NDArray[np.float64] | None = None
    source: str = ""
    sha256: str = ""
    findings: tuple[Finding, ...] = ()
    valid: NDArray[np.bool_] = None  # type: ignore[assignment] - all True
    rows: NDArray[np.int32] = None  # type: ignore[assignment] - from 2 on
    file_time: NDArray[np.float64] = None  # type: ignore[assignment] - time
    noise_settings: NoiseSettings = NoiseSettings()

    def __post_init__(self) -> None:
        n, k = np.size(self.time), len(self.joints)
        shapes = {"time": (n,), "gyro_z": (n,), "pose": (n, 3)}
        shapes |= dict.fromkeys(("velocity", "effort", "position", "command"), (n, k))
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None:
                # A frozen dataclass refuses assignment; the checked copy replaces the given one.
                object.__setattr__(self, name, self._checked(name, value, shape))
        if n < 2 or not (np.diff(self.time) > 0).all():
            raise InputError(f"log {self.name}: time does not increase; sort the samples")
        defaults = {
            "valid": np.ones(n, bool),
            "rows": np.arange(2, n + 2, dtype=np.int32),
            "file_time": self.time,
        }
        for name, default in defaults.items():
            value = getattr(self, name)
            object.__setattr__(self, name, _frozen(default if value is None else value))

    def _checked(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
        # Always a copy: it becomes read-only, and the caller's array must stay writable.
        array = np.array(value, dtype=float)
        if array.shape != shape:
            raise InputError(f"log {self.name}: {name} has shape {array.shape}, not {shape}")
        if not np.isfinite(array).all():
            raise InputError(f"log {self.name}: {name} holds NaN or infinity; cut it out")
        return _frozen(array)

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def speed_noise(self) -> NDArray[np.float64]:
        """White noise (k,) of the speeds, as `checks.noise_estimate` gives it."""
        return white_noise(self.velocity, self.valid, self.noise_settings)

    @property
    def warnings(self) -> list[str]:
        """What was repaired or looks wrong, a sentence each; of what looks wrong the cure too."""
        return [f"{self.name}: {sentence}" for sentence in self.doubts]

    @property
    def doubts(self) -> list[str]:
        """The same without the log's name."""
        told = (f for f in self.findings if f.level in ("warning", "repaired"))
        return [_sentence(finding) for finding in told]

    @property
    def reference(self) -> dict[str, str]:
        """How a model names the log that it was fitted on."""
        return {"name": self.name, "sha256": self.sha256}

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        # The mean step: single steps carry the rounding of the file.
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def rate(self) -> float:
        """Sample rate [Hz]."""
        return 1.0 / self.dt

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])


def shared_clock(logs: Sequence[Log]) -> dict[str, float] | None:
    """Start and end [s] of the clock that logs share; None where their times overlap."""
    spans = sorted((float(log.time[0]), float(log.time[-1])) for log in logs)
    if any(end >= start for (_, end), (start, _) in pairwise(spans)):
        return None
    return {"start": spans[0][0], "end": spans[-1][1]}


def in_order_of_time(logs: Sequence[Log]) -> list[Log]:
    """The logs, the earliest first, where they share a clock; else in the order given.

    Names of files need not say what came first, and an effect may act since a certain log.
    """
    return list(logs) if shared_clock(logs) is None else sorted(logs, key=lambda log: log.time[0])


def starts_on_shared_clock(
    logs: Sequence[Log],
    clock: Mapping[str, float] | None = None,
    of_clock: Collection[str] = (),
) -> list[float]:
    """When each log begins [s] after the first one, on the clock that they share.

    Logs whose times overlap share none, and begin at zero each.

    Parameters
    ----------
    clock : of other logs, from whose start to count where these go on after its end
    of_clock : hashes of these other logs, which may be among the logs too
    """
    own = shared_clock(logs)
    if own is None:
        return [0.0] * len(logs)
    origin = own["start"]
    if clock is not None:
        new = [log for log in logs if not log.sha256 or log.sha256 not in of_clock]
        if all(log.time[0] > clock["end"] for log in new):
            origin = clock["start"]
    return [float(log.time[0]) - origin for log in logs]


def warnings_of_logs(logs: Iterable[Log]) -> list[str]:
    """What was repaired or looks wrong in some logs; what is wrong with several is told once."""
    return grouped((log.name, sentence) for log in logs for sentence in log.doubts)


def _sentence(finding: Finding) -> str:
    column = f"{finding.column} " if finding.column and not finding.names_its_column else ""
    cure = f"; {finding.cure}" if finding.cure and finding.level == "warning" else ""
    return f"{column}{finding.message}{cure}"


def _frozen(array: NDArray) -> NDArray:
    array = np.asarray(array)
    array.setflags(write=False)
    return array
