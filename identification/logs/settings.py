"""All numbers that somebody chose for the checks and repairs of a log, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from identification.kinematics.settings import KinematicsSettings
from identification.signals.held import HeldSettings
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
    held: HeldSettings = field(default_factory=HeldSettings)
    kinematics: KinematicsSettings = field(default_factory=KinematicsSettings)

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
    max_moved_rows: int = field(
        default=10,
        metadata={"unit": "rows", "reason": "packets overtake each other by no more"},
    )
    min_sorted_share: float = field(
        default=0.98,
        metadata={
            "unit": "share of the steps",
            "reason": "regular after sorting: then the times are right and the order was not",
        },
    )
    min_rounded_share: float = field(
        default=0.3,
        metadata={
            "unit": "share of the rows",
            "reason": "with the time of the row before: more are digits that were lost",
        },
    )
    least_epoch: float = field(
        default=1e8,
        metadata={"unit": "s", "reason": "times since 1970 are above; no log runs for three years"},
    )
    max_clock_settings: int = field(
        default=3, metadata={"unit": "1", "reason": "a clock is not set more often in a run"}
    )
    max_same_time_share: float = field(
        default=0.01,
        metadata={
            "unit": "share of the rows",
            "reason": "rows that repeat a time with other values: one now and then is a slip, and "
            "the later row is dropped; more are a clock that is coarser than the log",
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
    max_lateness: float = field(
        default=0.1,
        metadata={"unit": "s", "reason": "of a message on a busy computer; more is a pause"},
    )
    lateness_time: float = field(
        default=0.5,
        metadata={"unit": "s", "reason": "over which jitter averages out"},
    )
    max_slow_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of the jitter",
            "reason": "that stays over that time: lost rows make 0.9, jitter 0.2 at 50 Hz",
        },
    )
    min_lattice_share: float = field(
        default=0.95,
        metadata={
            "unit": "share of the steps",
            "reason": "that are whole numbers of the usual one, to a tenth: rows are lost, times "
            "do not jitter",
        },
    )
    max_stamped_share: float = field(
        default=0.97,
        metadata={
            "unit": "1",
            "reason": "bends by the stamps over bends by the rows' numbers: less, and the values "
            "were taken at the stamps",
        },
    )
    max_burst_step: float = field(
        default=0.25,
        metadata={"unit": "mean steps", "reason": "steps within a burst are shorter"},
    )
    min_burst_steps: float = field(
        default=0.3,
        metadata={
            "unit": "share of the steps",
            "reason": "bursts of two rows have a half; jitter of half a step a sixth",
        },
    )
    min_cubic_step: float = field(
        default=0.4,
        metadata={"unit": "steps", "reason": "samples that are closer magnify noise twice"},
    )
    burst_quantile: float = field(
        default=0.25,
        metadata={
            "unit": "1",
            "reason": "of the steps: a usual one within a burst",
        },
    )
    min_burst_pause: float = field(
        default=3.0,
        metadata={
            "unit": "steps within a burst",
            "reason": "a longer one is a pause; jitter of a tenth never makes one",
        },
    )
    min_burst_share: float = field(
        default=0.06,
        metadata={
            "unit": "share of the steps",
            "reason": "pauses more often than that are no lost rows",
        },
    )
    max_burst_share: float = field(
        default=0.55,
        metadata={
            "unit": "share of the steps",
            "reason": "bursts of two rows have a pause every other step",
        },
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
    min_alternate_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of the rows",
            "reason": "with either speeds or efforts: rows of two topics, one after the other",
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
            "reason": "2.4 m/s: three times what the youBot's motors reach (0.8 m/s); of smaller "
            "wheels as much of the rim",
        },
    )
    max_wheel_effort: float = field(
        default=100.0,
        metadata={
            "unit": "N m",
            "reason": "ten times what its 10 A fuse lets a motor give (0.866 N m/A); of a larger "
            "platform as its volume and its wheels' radius",
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
    max_resting_speed_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of the usual speed",
            "reason": "a joint that is faster moves, whatever the noise: that of coarse counts may "
            "be above all speeds",
        },
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
    saturated_runs: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "times that a limit is met, from as many other values; a step command or a "
            "square wave is met once, or from one value",
        },
    )
    max_limit_step: float = field(
        default=0.25,
        metadata={
            "unit": "share of the channel's span",
            "reason": "a limit is met from nearby, a commanded step by a jump",
        },
    )
    min_limit_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of the channel's largest size",
            "reason": "an extreme that is smaller is what holds a joint, not a limit of its drive",
        },
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

    # How channels were logged
    min_zero_share: float = field(
        default=0.002,
        metadata={
            "unit": "share of the samples",
            "reason": "counted speeds are zero now and then, measured ones hardly ever",
        },
    )
    min_counted_step: float = field(
        default=0.05,
        metadata={
            "unit": "share of the usual speed",
            "reason": "finer counts are noise like any other",
        },
    )
    max_one_step: float = field(
        default=1.6,
        metadata={
            "unit": "least speeds",
            "reason": "speeds of one count lie below, those of two above",
        },
    )
    max_counted_step: float = field(
        default=0.5,
        metadata={
            "unit": "share of the usual speed",
            "reason": "coarser counts show no acceleration",
        },
    )
    min_straight_share: float = field(
        default=0.45,
        metadata={
            "unit": "share of the rows",
            "reason": "on a line with their neighbours: one of two where every other row is "
            "measured; of measured channels hardly any",
        },
    )
    max_straight_bend: float = field(
        default=1e-3,
        metadata={"unit": "usual bends", "reason": "a line's own bends are rounding"},
    )
    min_bend_digits: float = field(
        default=30.0,
        metadata={
            "unit": "least bends",
            "reason": "bends of the size of a file's last digits say nothing",
        },
    )
    small_effort_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the largest effort",
            "reason": "below it an effort has come down to zero",
        },
    )
    min_small_share: float = field(
        default=0.01,
        metadata={
            "unit": "share of the time",
            "reason": "an effort without its sign comes down to zero at each reversal",
        },
    )
    push_window: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "windows in which efforts are told from their noise",
        },
    )
    max_idle_effort: float = field(
        default=1.5,
        metadata={
            "unit": "standard deviations of the noise",
            "reason": "root mean square of a window in which nothing but noise is measured",
        },
    )
    max_idle_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of the windows",
            "reason": "with more the efforts are never above noise: nothing to compare with",
        },
    )
    min_pushed_rise: float = field(
        default=0.3,
        metadata={
            "unit": "share of the usual speed",
            "reason": "a joint that coasts slows down: one that speeds up is driven",
        },
    )
    min_push_windows: int = field(
        default=2,
        metadata={
            "unit": "windows",
            "reason": "a single one may be chance",
        },
    )
    max_other_force: float = field(
        default=0.1,
        metadata={
            "unit": "share of the efforts' squares",
            "reason": "that inertia and friction of each axis leave; another order than the right "
            "one leaves 0.15 to 0.4 (simulated logs)",
        },
    )
    max_other_order_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of what the given order leaves",
            "reason": "the right order leaves half or less; on 80 logs without fault none of the "
            "others leaves less than the given one",
        },
    )

    # Efforts against the motion
    min_offset_rows: int = field(
        default=100, metadata={"unit": "rows of 0.1 s", "reason": "for some twenty coefficients"}
    )
    offset_memory: float = field(
        default=1.0,
        metadata={"unit": "s", "reason": "what the regression leaves is alike for as long"},
    )
    offset_deviations: float = field(
        default=8.0,
        metadata={
            "unit": "standard deviations",
            "reason": "dry friction alone makes up to 7.3 of a log without offsets",
        },
    )
    sure_offset_deviations: float = field(
        default=7.0,
        metadata={
            "unit": "standard deviations",
            "reason": "where the regression leaves noise alone nothing but an offset makes more: a "
            "lag of the drives and a cable that twists make 6, offsets of 0.02 N m make 10",
        },
    )
    max_left_of_efforts: float = field(
        default=0.0015,
        metadata={
            "unit": "share of an effort's squares",
            "reason": "of each wheel; noise leaves up to 0.001 of means over 0.1 s, dry friction "
            "and a carpet's nap 0.002 and more in one wheel at least",
        },
    )
    max_offset_share: float = field(
        default=1.5,
        metadata={
            "unit": "share of the effort's root mean square",
            "reason": "a real offset makes 1 at most; rough floors, on motions that hardly turn, "
            "gave offsets of 10 times the efforts",
        },
    )
    min_offset_share: float = field(
        default=0.02,
        metadata={"unit": "share of the usual effort", "reason": "a smaller offset hardly matters"},
    )
    resting_deviations: float = field(
        default=3.0,
        metadata={"unit": "standard deviations of the noise", "reason": "a wheel below may stand"},
    )
    min_rest_time: float = field(
        default=0.5,
        metadata={"unit": "s", "reason": "a reversal is shorter"},
    )
    min_rest_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the usual effort",
            "reason": "what dry friction holds at rest is mostly less, and differs",
        },
    )
    min_noise_decay: float = field(
        default=0.3,
        metadata={"unit": "1", "reason": "autocorrelation over a row; less is white noise"},
    )
    max_noise_decay: float = field(
        default=0.93,
        metadata={"unit": "1", "reason": "more is no noise: a wheel of another size makes 0.95"},
    )
    max_decay_error: float = field(
        default=0.08,
        metadata={
            "unit": "1",
            "reason": "of the autocorrelations over 2 to 5 rows against the first's powers; the "
            "rollers of the contact simulator are 0.25 off",
        },
    )
    max_mean_error: float = field(
        default=0.05,
        metadata={"unit": "1", "reason": "the same against a straight fall, of means over rows"},
    )
    max_mass_std: float = field(
        default=0.15,
        metadata={"unit": "share", "reason": "a mass by turns known less well tells no unit"},
    )
    usual_mass_ratio: float = field(
        default=1.3,
        metadata={
            "unit": "1",
            "reason": "mass by accelerations, in which the wheels' spin is, over that by turns: "
            "1.0 to 2.5 in 60 logs of all kinds",
        },
    )
    max_unit_doubt: float = field(
        default=3.0,
        metadata={"unit": "1", "reason": "a unit is at least 4 off; lags make 2.3"},
    )
    max_left_for_masses: float = field(
        default=0.005,
        metadata={
            "unit": "share of the forces' squares",
            "reason": "at most 0.001 on platforms that lack no effect, in any unit or order; where "
            "more is left, what is missing may set the masses apart: one wheel's friction turned "
            "the sign of one (0.011), a clipped torque made them differ by 4 (0.08)",
        },
    )
    min_nearer_mass: float = field(
        default=2.0,
        metadata={
            "unit": "1",
            "reason": "factor by which a mass must be nearer to the usual one in another unit of "
            "the speeds: turns/s make 6.3 of it, and a floor that is rough in places leaves the "
            "mass by accelerations as it is",
        },
    )
    max_platform_mass: float = field(
        default=300.0,
        metadata={
            "unit": "kg",
            "reason": "of the youBot's size; of larger ones as the volume",
        },
    )
    usual_platform_mass: float = field(
        default=45.0,
        metadata={
            "unit": "kg",
            "reason": "by which the efforts' unit is guessed: the youBot's, of others as the "
            "volume",
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
    power_time: float = field(
        default=0.1,
        metadata={
            "unit": "s",
            "reason": "means over it are fitted where a sign is judged: noise of the acceleration "
            "would hide the inertia",
        },
    )
    min_share_of_way: float = field(
        default=0.1,
        metadata={
            "unit": "share of the time",
            "reason": "a motion with less of one way is one-way: a load may drive it",
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
    min_overflow_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of a channel's span",
            "reason": "that a number which overflows leaps by in one row: all, less two steps",
        },
    )
    overflow_surroundings: int = field(
        default=3,
        metadata={"unit": "rows", "reason": "over which its slope is taken, beside a leap"},
    )
    min_overflows: int = field(
        default=4,
        metadata={"unit": "1", "reason": "one or two such leaps are outliers, and mended"},
    )
    min_overflow_agreement: float = field(
        default=0.8,
        metadata={
            "unit": "share of the leaps",
            "reason": "after which the channel goes on as before; by chance half of them would, of "
            "both slopes a quarter",
        },
    )
    min_frame_yaw: float = field(
        default=0.1,
        metadata={
            "unit": "rad",
            "reason": "of a heading that is measured askew: three times what a real capture had",
        },
    )
    lost_pose_time: float = field(
        default=0.3,
        metadata={
            "unit": "s",
            "reason": "without a new pose: slower trackers than 4 Hz are none for a robot",
        },
    )
    lost_pose_periods: float = field(
        default=5.0,
        metadata={"unit": "usual times between poses", "reason": "a few messages may be lost"},
    )
    min_lost_way: float = field(
        default=0.05,
        metadata={"unit": "m", "reason": "a leap or a rest of less is within a tracker's error"},
    )
    wheel_delay_block: float = field(
        default=0.04,
        metadata={
            "unit": "s",
            "reason": "of a mean speed: noise of 0.01 rad/s then leaves an acceleration within a "
            "tenth of usual ones",
        },
    )
    min_delay_eigenvalue: float = field(
        default=0.01,
        metadata={
            "unit": "share of the largest",
            "reason": "motions along one axis accelerate all wheels alike, and tell none apart",
        },
    )
    min_delay_evidence: float = field(
        default=1.0,
        metadata={
            "unit": "times the noise's squares",
            "reason": "what breaks the identity must be more than noise, which is known to a tenth",
        },
    )
    max_left_by_delay: float = field(
        default=0.3,
        metadata={
            "unit": "share of the squares",
            "reason": "that delays leave of what breaks the identity: slip and radii have none in "
            "step with accelerations",
        },
    )
    min_wheel_delay: float = field(
        default=1e-3,
        metadata={"unit": "s", "reason": "at 5 rad/s^2 it is less than usual noise of a speed"},
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
    scale_time: float = field(
        default=1.0,
        metadata={
            "unit": "s",
            "reason": "pieces whose way gives the scale of a pose, far above its noise",
        },
    )
    lag_grid: float = field(
        default=0.05,
        metadata={
            "unit": "s",
            "reason": "steps in which speeds and pose are shifted: a tenth of the longest lag",
        },
    )
    max_left_by_lag: float = field(
        default=0.5,
        metadata={
            "unit": "share of the squares without a lag",
            "reason": "a lag that takes away less is noise, slip or a wrong length",
        },
    )
    max_unlike_pose: float = field(
        default=0.05,
        metadata={
            "unit": "share of the squares of the wheels' ways",
            "reason": "a wheel of 10 % more leaves 1e-4; more is no matter of a gain or a lag",
        },
    )
    min_scale_difference: float = field(
        default=0.02,
        metadata={
            "unit": "share",
            "reason": "less may be slip: the contact simulator has 0.5 %",
        },
    )
    scale_deviations: float = field(
        default=3.0,
        metadata={
            "unit": "standard deviations",
            "reason": "beyond, the pose has another scale than the wheels",
        },
    )
    interval_deviations: float = field(
        default=1.96,
        metadata={
            "unit": "standard deviations",
            "reason": "either side of a radius: they hold a Gaussian truth in 95 % of cases",
        },
    )
    max_radius_ratio: float = field(
        default=1.25,
        metadata={
            "unit": "1",
            "reason": "no radius is as wrong: beyond, time or a unit is",
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
