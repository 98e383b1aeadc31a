"""All numbers that somebody chose for the checks and repairs of a log, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from identification.signals.noise import NoiseSettings
from youbot_env.errors import InputError, Settings, check_settings


@dataclass(frozen=True)
class LogSettings(Settings):
    """What the reading of a log repairs, doubts and refuses.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive, or a share is not below 1.
    """

    noise: NoiseSettings = field(default_factory=NoiseSettings)

    # Time column
    min_step: float = field(
        default=1e-3,
        metadata={"unit": "s", "reason": "1 kHz: faster logs are thinned by their owner"},
    )
    max_step: float = field(
        default=1 / 20,
        metadata={"unit": "s", "reason": "20 Hz: slower logs hardly show an acceleration"},
    )
    max_step_deviation: float = field(
        default=0.02,
        metadata={
            "unit": "share of the step",
            "reason": "a logger's clock may be as much off the rate that it is set to",
        },
    )
    min_rows: int = field(
        default=50, metadata={"unit": "rows", "reason": "fewer are no motion at any rate"}
    )
    max_untimed_share: float = field(
        default=0.02,
        metadata={
            "unit": "share of the rows",
            "reason": "more rows without a time are a fault of the logger, not single losses",
        },
    )
    max_gap_samples: int = field(
        default=5,
        metadata={"unit": "samples", "reason": "a gap as long is bridged at low rates"},
    )
    max_gap_time: float = field(
        default=0.02,
        metadata={"unit": "s", "reason": "a gap as long is bridged at high rates"},
    )
    longest_gap_time: float = field(
        default=0.2,
        metadata={"unit": "s", "reason": "never more: the motion in it is anyone's guess"},
    )
    max_missing_row_share: float = field(
        default=0.1,
        metadata={"unit": "share of the rows", "reason": "with more the logger loses samples"},
    )
    max_jitter: float = field(
        default=0.03,
        metadata={
            "unit": "share of the step",
            "reason": "root-mean-square deviation of regular steps; beyond, a log is resampled",
        },
    )
    max_step_offset: float = field(
        default=0.25,
        metadata={"unit": "share of the step", "reason": "the same for a single step"},
    )
    bridge_samples: int = field(
        default=4,
        metadata={
            "unit": "samples a side",
            "reason": "a cubic through twice as many averages their noise and leaves no kink",
        },
    )

    # Missing values and outliers
    max_magnitude: float = field(
        default=1e9,
        metadata={
            "unit": "SI",
            "reason": 'no channel reaches this; sentinels such as 1e38 mean "no value"',
        },
    )
    max_missing_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the rows",
            "reason": "a channel that lacks more of its values is not filled",
        },
    )
    max_outlier_share: float = field(
        default=0.01,
        metadata={"unit": "share of the rows", "reason": "more outliers are no single ones"},
    )
    outlier_deviations: float = field(
        default=10.0,
        metadata={
            "unit": "standard deviations of the noise",
            "reason": "least leap of an outlier: noise never leaps as far",
        },
    )
    usual_step_quantile: float = field(
        default=0.99,
        metadata={"unit": "1", "reason": "steps up to this quantile are a channel's usual ones"},
    )
    outlier_steps: float = field(
        default=5.0,
        metadata={
            "unit": "usual steps",
            "reason": "least leap of an outlier: a steep motion is none",
        },
    )
    max_outlier_samples: int = field(
        default=3, metadata={"unit": "samples", "reason": "what lasts longer may be real"}
    )
    outlier_surroundings: int = field(
        default=6,
        metadata={"unit": "samples a side", "reason": "that must be quiet around an outlier"},
    )
    max_surrounding_step: float = field(
        default=0.4,
        metadata={
            "unit": "share of the leap",
            "reason": "largest step around an outlier: a chattering friction is none",
        },
    )
    min_leap_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of the least leap",
            "reason": "steps from which on an outlier is looked for: its neighbours may differ",
        },
    )

    # Limits and motion
    max_wheel_speed: float = field(
        default=50.0,
        metadata={
            "unit": "rad/s",
            "reason": "2.4 m/s: three times what the youBot's motors reach (0.8 m/s)",
        },
    )
    max_wheel_effort: float = field(
        default=100.0,
        metadata={
            "unit": "N m",
            "reason": "ten times what its 10 A fuse lets a motor give (0.866 N m/A)",
        },
    )
    doubtful_limit_share: float = field(
        default=0.5,
        metadata={"unit": "share of the limit", "reason": "from here on a unit is doubtful"},
    )
    min_motion_time: float = field(
        default=2.0, metadata={"unit": "s", "reason": "of motion that a log must show"}
    )
    min_wheel_speed: float = field(
        default=0.2,
        metadata={"unit": "rad/s", "reason": "below it friction at standstill hides all else"},
    )
    moving_noise_deviations: float = field(
        default=6.0,
        metadata={
            "unit": "standard deviations of the noise",
            "reason": "a speed beyond is motion, not noise",
        },
    )
    moving_speed_share: float = field(
        default=0.05,
        metadata={"unit": "share of the usual speed", "reason": "a speed beyond is motion"},
    )
    usual_speed_quantile: float = field(
        default=0.95,
        metadata={"unit": "1", "reason": "the speed that a log hardly exceeds"},
    )

    # Sensors
    frozen_time: float = field(
        default=0.2,
        metadata={"unit": "s", "reason": "a noisy channel never holds one value as long"},
    )
    frozen_samples: int = field(
        default=10, metadata={"unit": "samples", "reason": "the same at low rates"}
    )
    max_repeated_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the samples",
            "reason": "a channel that repeats values more often elsewhere is coarse, not frozen",
        },
    )
    max_stale_share: float = field(
        default=0.01,
        metadata={
            "unit": "share of the rows",
            "reason": "more repeated rows: logged faster than measured",
        },
    )
    saturated_samples: int = field(
        default=10,
        metadata={"unit": "samples", "reason": "fewer at an extreme are a peak"},
    )
    max_saturated_share: float = field(
        default=0.01,
        metadata={"unit": "share of the samples", "reason": "more at an extreme are a limit"},
    )
    position_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "pieces over which a position is compared with its speed: short ones drift "
            "little, long ones hold more than rounding",
        },
    )
    max_position_error: float = field(
        default=0.1,
        metadata={
            "unit": "share of the way",
            "reason": "beyond, a unit, a sign or a wrap is wrong",
        },
    )

    # Signs and slip of the wheels
    driving_share: float = field(
        default=0.3,
        metadata={
            "unit": "share of the strongest joint's power",
            "reason": "joints below are dragged along: their power tells no sign",
        },
    )
    max_fed_back_power: float = field(
        default=0.3,
        metadata={
            "unit": "net over gross power",
            "reason": "an effort that takes more has a wrong sign; sound logs give above 0.9",
        },
    )
    max_slip: float = field(
        default=0.1,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "that no rigid motion explains: a log with more is doubtful",
        },
    )
    impossible_slip: float = field(
        default=0.35,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "a log with more is refused; four independent speeds would have one half",
        },
    )
    resting_slip: float = field(
        default=0.01,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "with less, wheels at rest are a turn about a point beside the platform",
        },
    )
    slip_noise_deviations: float = field(
        default=4.0,
        metadata={
            "unit": "standard deviations of the noise",
            "reason": "what noise alone makes of the identity never reaches it",
        },
    )
    slip_time: float = field(
        default=0.2,
        metadata={"unit": "s", "reason": "moments over which slip is averaged"},
    )
    min_slip_of_still_wheel: float = field(
        default=0.02,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "slip at which a wheel whose speed is constant has a dead encoder",
        },
    )
    max_remaining_slip: float = field(
        default=0.3,
        metadata={
            "unit": "share of the slip",
            "reason": "other signs or scales must leave no more, to be named as the cure",
        },
    )
    max_scale_eigenvalue: float = field(
        default=0.05,
        metadata={
            "unit": "share of the next eigenvalue",
            "reason": "one combination of wheels must stand out as the one that is always zero",
        },
    )
    max_other_scale: float = field(
        default=0.1,
        metadata={
            "unit": "1",
            "reason": "a wheel is off by a factor only where the other three agree as well",
        },
    )
    slip_noise_ratio: float = field(
        default=1.5,
        metadata={
            "unit": "times the noise",
            "reason": "from here on slip exceeds noise, which is known to a few percent",
        },
    )
    negligible_slip: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "does not matter, however small the noise",
        },
    )

    # Pose and gyro against the wheels
    pose_time: float = field(
        default=0.1,
        metadata={"unit": "s", "reason": "pieces whose way is compared: above a pose's rounding"},
    )
    min_compared_size: float = field(
        default=1e-3,
        metadata={
            "unit": "rad/s, rad or m",
            "reason": "root mean square below which the wheels say nothing to compare with",
        },
    )
    max_gain_ratio: float = field(
        default=3.0,
        metadata={
            "unit": "1",
            "reason": "a sensor this many times off the wheels has another unit; slip has less",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "log settings", positive=True)
        for name in ("usual_step_quantile", "usual_speed_quantile"):
            if getattr(self, name) >= 1.0:
                raise InputError(f"log settings: {name} must be below 1")
        if self.min_step >= self.max_step:
            raise InputError("log settings: min_step must be below max_step")
