"""All numbers that somebody chose for how logs of a mechanism are read and judged."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import check_settings, finite


@dataclass(frozen=True)
class MechanismSettings:
    """What a mechanism's motion, demanded force and parts of logs depend on, and its warnings.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.

    Raises
    ------
    InputError
        If a number is not finite, is negative, or is zero where something is divided by it.
    """

    # Demanded force
    internal_torque_smoothing_time: float = field(
        default=0.05,
        metadata={
            "unit": "s",
            "reason": "standard deviation of the Gaussian that smooths the internal torque: its "
            "noise would enter the columns",
        },
    )
    torque_rate_smoothing_time: float = field(
        default=0.03,
        metadata={
            "unit": "s",
            "reason": "standard deviation of the Gaussian that smooths torques before their rate "
            "is taken: the demanded torque holds the speeds' noise differentiated, its rate holds "
            "it twice, and unsmoothed it would be most of the column of a drive's lag and pull "
            "the lag towards zero",
        },
    )

    # Speeds that are differences of counted angles
    max_difference_noise_share: float = field(
        default=0.005,
        metadata={
            "unit": "share of the speeds' root mean square",
            "reason": "noise that the low-pass leaves on such speeds: 0.02 rad/s of 4 rad/s, at "
            "which base parameters were off by 0.4 standard deviations over six platforms; it "
            "means 5 Hz at 500 counts a turn and 100 Hz",
        },
    )
    min_bandwidth: float = field(
        default=2.0,
        metadata={
            "unit": "Hz",
            "reason": "less would take the motion away: calibration motions have 0.2 Hz and some "
            "harmonics, multisines up to 1 Hz",
        },
    )

    # Wheel angles of a platform
    max_drift_deviations: float = field(
        default=4.0,
        metadata={
            "unit": "standard deviations of a random walk",
            "reason": "noise on a wheel's speed makes its integrated angle walk randomly; a pose "
            "that departs from it by more shows slip",
        },
    )
    max_pose_angle_error: float = field(
        default=0.02,
        metadata={
            "unit": "rad",
            "reason": "of a wheel: a pose may be off by as much, by rounding and by turning "
            "between samples",
        },
    )

    # Parts of a platform's log
    part_window_duration: float = field(
        default=5.0,
        metadata={
            "unit": "s",
            "reason": "judged at once: about one period of a calibration motion",
        },
    )
    part_window_step: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "from one window to the next: how finely the change of motion is placed",
        },
    )
    min_part_duration: float = field(
        default=8.0,
        metadata={"unit": "s", "reason": "a shorter part is not worth a judgement of its own"},
    )
    max_still_speed_share: float = field(
        default=0.2,
        metadata={
            "unit": "share of the fastest wheel's speed",
            "reason": "below it a wheel counts as standing (measured: 0.13)",
        },
    )
    max_yaw_speed_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the platform's speed",
            "reason": "below it a platform does not turn, as in motion III",
        },
    )
    yaw_lever: float = field(
        default=0.4,
        metadata={
            "unit": "m",
            "reason": "by it a yaw rate is compared with a speed: about L of the youBot",
        },
    )
    max_velocity_scatter_share: float = field(
        default=0.2,
        metadata={
            "unit": "share of the platform's speed",
            "reason": "below it the velocity in the world is constant, as in motion IV; the same "
            "as for a standing wheel",
        },
    )

    # Scales of one axis
    axis_bandwidths: tuple[float, ...] = field(
        default=(100.0, 30.0),
        metadata={
            "unit": "rad/s",
            "reason": "tried in turn for a fit, beyond the usual filter's 10 rad/s: an axis may "
            "be much faster than a platform",
        },
    )
    max_bandwidth_times_sample_time: float = field(
        default=0.3,
        metadata={"unit": "1", "reason": "a faster filter hardly sees its own time constant"},
    )
    max_inertia_attenuation: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the inertia",
            "reason": "that noise of the speed may hide in a fit",
        },
    )
    acceleration_averaging_time: float = field(
        default=0.05,
        metadata={
            "unit": "s",
            "reason": "a speed is averaged over it before its typical rate is judged, which noise "
            "would make too large",
        },
    )

    # Limits of a fitted model
    min_platform_mass_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the four wheels' mass",
            "reason": "a platform without its wheels weighs more; a fit that is pulled below stops "
            "here, where its centre of mass is still defined",
        },
    )
    min_platform_mass: float = field(
        default=0.01,
        metadata={"unit": "kg", "reason": "the same where the geometry says that wheels weigh 0"},
    )
    max_platform_mass: float = field(
        default=200.0,
        metadata={
            "unit": "kg",
            "reason": "of the youBot's size, with what the wheels add, and of larger ones as the "
            "volume; beyond, speeds are in turns/s (35 kg would show 290), or torques in another "
            "unit",
        },
    )
    min_axis_inertia_share: float = field(
        default=1e-3,
        metadata={
            "unit": "share of an axis' typical inertia",
            "reason": "a fit that is pulled below stops here: an axis without inertia cannot be",
        },
    )
    min_moving_speed_share: float = field(
        default=0.02,
        metadata={
            "unit": "share of the axis' typical speed",
            "reason": "an averaged speed below it counts as standing: an encoder's last count, "
            "not a motion back",
        },
    )
    min_creep_deviations: float = field(
        default=6.0,
        metadata={
            "unit": "standard deviations of an averaged speed's noise",
            "reason": "a faster axis moves; chance exceeds it nowhere in a log",
        },
    )
    min_creep_share: float = field(
        default=0.001,
        metadata={
            "unit": "share of the fastest speed",
            "reason": "the same where speeds have no noise: the tail of a control loop's approach",
        },
    )
    min_rest_duration: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "a shorter standstill is a passage through it. Longer rests are no rows of "
            "a fit: held torques made 39 to 69 % of a residual predictable, and a cogging",
        },
    )
    min_stop_duration: float = field(
        default=0.1,
        metadata={
            "unit": "s",
            "reason": "from here on a joint stands, and is not turned about: what is left there is "
            "large at times only, where its dry friction is real",
        },
    )
    min_moving_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of a platform's log",
            "reason": "of a log that holds less motion, what stands still is not left out: too "
            "few rows would be left for a fit",
        },
    )
    max_other_way_share: float = field(
        default=0.01,
        metadata={
            "unit": "share of the time in motion",
            "reason": "up to here an axis moves one way only: an overshoot at a stop does not "
            "tell dry friction from a constant force",
        },
    )

    # Warnings of a fitted model
    max_deviation_share: float = field(
        default=0.2,
        metadata={
            "unit": "share of the value",
            "reason": "a parameter with a larger standard deviation is called barely observable: "
            "its 95 % interval is wider than 40 % either side",
        },
    )
    interval_deviations: float = field(
        default=1.96,
        metadata={
            "unit": "standard deviations",
            "reason": "a parameter that cannot be negative and is within so many of zero is not "
            "shown; 95 %, as of a fit's intervals",
        },
    )
    negligible_value_share: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the parameter's size",
            "reason": "below it a value stands at its bound of zero, up to rounding",
        },
    )
    max_published_difference: float = field(
        default=0.05,
        metadata={
            "unit": "share of the value",
            "reason": "mass and inertia as near to the paper's are the paper's: its gyration "
            "radius beyond the wheels is known, and is no news from a log",
        },
    )
    min_gyration_radius_share: float = field(
        default=0.3,
        metadata={
            "unit": "share of the wheels' distance from the centre",
            "reason": "the youBot's four wheels alone make 0.4",
        },
    )
    max_wheel_inertia_ratio: float = field(
        default=2.0,
        metadata={
            "unit": "of a solid wheel's",
            "reason": "beyond it the motor's rotor is named, which the gear makes count more",
        },
    )
    min_wheel_inertia_ratio: float = field(
        default=0.3,
        metadata={
            "unit": "of a solid wheel's",
            "reason": "a rim has 2, a solid wheel 1: less is hardly possible",
        },
    )
    max_run_samples: int = field(
        default=120_000,
        metadata={
            "unit": "samples",
            "reason": "of a free run that are simulated at once: two minutes at 1 kHz; the states "
            "of an hour would take half a gigabyte",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self)
        # Zero would divide by zero, or would be a filter that lets nothing through.
        for name in (
            "internal_torque_smoothing_time",
            "torque_rate_smoothing_time",
            "part_window_duration",
            "axis_bandwidths",
            "min_platform_mass",
            "min_axis_inertia_share",
        ):
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                finite(f"{type(self).__name__} {name}", number, positive=True)
