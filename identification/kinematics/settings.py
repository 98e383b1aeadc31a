"""All numbers that somebody chose for the estimation of lengths, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class KinematicsSettings(Settings):
    """How radius, arm, delay, frame and slip are estimated from wheels and pose.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    max_pose_rate: float = field(
        default=50.0,
        metadata={"unit": "Hz", "reason": "a platform moves below 5 Hz: more poses cost only time"},
    )
    max_hold_time: float = field(
        default=0.2,
        metadata={
            "unit": "s",
            "reason": "a pose that stays as long is one at rest, of which some are kept",
        },
    )
    yaw_smoothing_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "the yaw of the wheels drifts by less than a pose's noise in it, so the pose "
            "corrects its slow part only",
        },
    )
    outlier_time: float = field(
        default=1.5,
        metadata={
            "unit": "s",
            "reason": "window of the median from which a pose leaps; outliers last less than half",
        },
    )
    outlier_deviations: float = field(
        default=5.0,
        metadata={
            "unit": "standard deviations",
            "reason": "of Gaussian noise one in two million is beyond",
        },
    )
    huber_deviations: float = field(
        default=2.0,
        metadata={
            "unit": "standard deviations",
            "reason": "larger residuals (a wheel that slips) weigh less; 99 % efficient",
        },
    )
    iterations: int = field(
        default=6,
        metadata={"unit": "1", "reason": "weights, noise and delay stand still after four"},
    )
    coarse_time: float = field(
        default=1.0,
        metadata={"unit": "s", "reason": "pieces of the first fit: their way is above the noise"},
    )
    median_poses: int = field(
        default=5,
        metadata={"unit": "poses", "reason": "a median over them takes outliers of two out"},
    )
    share_tolerance: float = field(
        default=0.5,
        metadata={
            "unit": "share of what the best leaves",
            "reason": "an order that leaves little more than the best is taken if it is simpler",
        },
    )
    min_explained_share: float = field(
        default=0.7,
        metadata={
            "unit": "share",
            "reason": "of the pose's ways that wheels in the right order explain; slip of 10 % "
            "leaves 0.9",
        },
    )
    min_related_share: float = field(
        default=0.3,
        metadata={
            "unit": "share",
            "reason": "with less the pose is of another run: chance explains up to a fifth",
        },
    )
    min_better_share: float = field(
        default=0.1,
        metadata={
            "unit": "share",
            "reason": "by which other columns or axes must explain more, to be named",
        },
    )
    usual_arm: float = field(
        default=0.3,
        metadata={
            "unit": "m",
            "reason": "makes turns and ways of one size: a platform's half size",
        },
    )
    lag_step: float = field(
        default=0.1,
        metadata={"unit": "s", "reason": "speeds of a pose of 2 mm over it have 3 cm/s of noise"},
    )
    max_delay: float = field(
        default=0.5,
        metadata={"unit": "s", "reason": "a filter or a bus is no slower; beyond, clocks differ"},
    )
    delay_step: float = field(
        default=0.02,
        metadata={"unit": "s", "reason": "grid from which the delay's refinement converges"},
    )
    max_clock_difference: float = field(
        default=5.0,
        metadata={"unit": "s", "reason": "clocks that differ by more share no motion in most logs"},
    )
    drift_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "increments over it tell drift from noise; over longer ones what creep and "
            "floor do bends the delay: 37 ms at 2 s and 43 ms at 0.5 s on a real robot's 50",
        },
    )
    min_slip: float = field(
        default=0.002,
        metadata={
            "unit": "share of the way",
            "reason": "wheels never roll more exactly; the contact simulator slips by 0.5 %",
        },
    )
    slip_memory: float = field(
        default=0.5,
        metadata={"unit": "s", "reason": "for which that slip lasts: a turn of a roller or so"},
    )
    even_slip_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the mean square speed",
            "reason": "slip grows with the speed; at rest a little of its variance stays",
        },
    )
    lever_prior: float = field(
        default=1.0,
        metadata={"unit": "m", "reason": "a tracked point lies on the platform"},
    )
    blocks: int = field(
        default=20,
        metadata={"unit": "1", "reason": "of time, left out in turn for the intervals"},
    )
    min_block_time: float = field(
        default=4.0,
        metadata={"unit": "s", "reason": "slip is alike within; longer blocks are independent"},
    )
    max_block_correlation: float = field(
        default=0.8,
        metadata={
            "unit": "1",
            "reason": "of neighbouring blocks: more is a drift over the whole log, not slip",
        },
    )
    max_relative_std: float = field(
        default=0.05,
        metadata={"unit": "share", "reason": "a length known less well is not shown"},
    )
    max_lever_std: float = field(
        default=0.1,
        metadata={"unit": "m", "reason": "a tracked point known less well is not shown"},
    )
    min_delay: float = field(
        default=0.005,
        metadata={"unit": "s", "reason": "half a sample of most logs: a smaller one is not told"},
    )
    min_frame_yaw: float = field(
        default=0.005,
        metadata={"unit": "rad", "reason": "0.3 degrees: a smaller one is not told"},
    )
    doubtful_frame_yaw: float = field(
        default=0.5,
        metadata={"unit": "rad", "reason": "no marker is mounted 30 degrees askew by chance"},
    )
    min_turning: float = field(
        default=1.0,
        metadata={
            "unit": "rad",
            "reason": "way of the yaw in all: with less, a drift of the wheels by 3 degrees is 5 % "
            "of L",
        },
    )
    min_travel: float = field(
        default=0.5,
        metadata={"unit": "m", "reason": "way in all: with less, 2 mm of noise are 0.5 % of R"},
    )

    max_same_unit_ratio: float = field(
        default=1.3,
        metadata={
            "unit": "1",
            "reason": "no radius is as far off its nominal: beyond, a unit or a gear is",
        },
    )
    radius_ratio: float = field(
        default=1.06,
        metadata={"unit": "1", "reason": "a usual error of a nominal radius counts 1"},
    )
    usual_radius: float = field(
        default=0.06,
        metadata={"unit": "m", "reason": "mecanum wheels on sale have 60 to 250 mm of diameter"},
    )
    usual_radius_ratio: float = field(
        default=1.5,
        metadata={"unit": "1", "reason": "a usual distance from that radius counts 1"},
    )
    max_unit_cost: float = field(
        default=3.0,
        metadata={
            "unit": "usual errors",
            "reason": "a unit that fits worse is none",
        },
    )
    odd_gear_cost: float = field(
        default=1.0,
        metadata={
            "unit": "usual errors",
            "reason": "a gear of 27:1 is rarer than one of 20:1, but some radius always fits it",
        },
    )
    gear_cost: float = field(
        default=0.5,
        metadata={"unit": "usual errors", "reason": "of a gear at all: drivers mostly undo it"},
    )
    rare_unit_cost: float = field(
        default=1.0,
        metadata={
            "unit": "usual errors",
            "reason": "of a unit such as degrees/s of a motor, 5 % from rad/min",
        },
    )
    rim_tolerance: float = field(
        default=0.08,
        metadata={"unit": "1", "reason": "speeds of the rim in m/s give a radius of 1 m"},
    )
    min_pieces: int = field(
        default=12, metadata={"unit": "pieces", "reason": "for twelve numbers of four wheels"}
    )
    min_excited_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the largest way",
            "reason": "a direction that is driven less shows no wheel's own lengths",
        },
    )
    min_wheel_difference: float = field(
        default=0.005,
        metadata={"unit": "share of the radius", "reason": "wear and tyre pressure make as much"},
    )
    wheel_deviations: float = field(
        default=3.5,
        metadata={
            "unit": "standard deviations",
            "reason": "of four wheels one is beyond by chance in one of 500 logs",
        },
    )
    max_frame_error: float = field(
        default=0.15,
        metadata={"unit": "rad", "reason": "one wheel that differs by 15 % turns the frame so"},
    )
    max_angle_std: float = field(
        default=0.02,
        metadata={"unit": "rad", "reason": "a roller angle known less well is not shown"},
    )
    min_angle_difference: float = field(
        default=0.02,
        metadata={"unit": "rad", "reason": "a degree is what rollers are mounted to"},
    )
    slip_window: float = field(
        default=0.5, metadata={"unit": "s", "reason": "over which slip is told from a pose's noise"}
    )
    slip_mean_time: float = field(
        default=0.1,
        metadata={"unit": "s", "reason": "of poses around the ends of a window: less noise"},
    )
    min_slip_share: float = field(
        default=0.1,
        metadata={"unit": "share of the usual way", "reason": "from here on a place is named"},
    )
    slip_deviations: float = field(
        default=5.0,
        metadata={"unit": "standard deviations", "reason": "of the pose's noise over a window"},
    )
    min_poses: int = field(
        default=30, metadata={"unit": "poses", "reason": "fewer are no motion at any rate"}
    )
    min_scale_difference: float = field(
        default=0.005,
        metadata={
            "unit": "share",
            "reason": "a length that differs by less from the geometry's is no finding: slip of "
            "the contact simulator makes 0.5 %",
        },
    )
    difference_deviations: float = field(
        default=3.0,
        metadata={"unit": "standard deviations", "reason": "beyond, a length is another one"},
    )
    length_units_ratio: float = field(
        default=2.5,
        metadata={
            "unit": "1",
            "reason": "arms of platforms differ by less from the youBot's 0.39 m, a pose in cm by "
            "100, in mm by 1000",
        },
    )
    radian_tolerance: float = field(
        default=0.1,
        metadata={"unit": "1", "reason": "angles that differ by less from speeds are radians"},
    )
    interval_deviations: float = field(
        default=1.96,
        metadata={"unit": "standard deviations", "reason": "95 % of a Gaussian"},
    )

    def __post_init__(self) -> None:
        check_settings(self, "kinematics settings", positive=True)
