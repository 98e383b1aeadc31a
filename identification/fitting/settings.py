"""All numbers that somebody chose for a fit, its intervals and its errors, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from identification.mechanisms.settings import MechanismSettings
from identification.signals.filters import FilterSettings, RowFilter
from identification.signals.held import HeldSettings
from identification.signals.noise import NoiseSettings
from youbot_env.errors import InputError, Settings, check_settings


@dataclass(frozen=True)
class PredictabilitySettings(Settings):
    """How it is tested whether anything is left that the motion predicts.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.
    """

    max_share_with_waves: float = field(
        default=0.5,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "that trees predict, up to which waves are looked for too: of a moment that "
            "swings in time they predicted 10 %, the wave 90 %",
        },
    )
    max_noise_share: float = field(
        default=0.08,
        metadata={
            "unit": "share of the residual's squares, held out",
            "reason": "up to here a residual is noise: -0.16 to 0.035 was measured for 48 of 49 "
            "logs under noise of ten kinds, 0.077 once for coarsely quantised speeds; 0.15 and "
            "more for 49 of 57 kinds of missing effects",
        },
    )
    max_held_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of all rows",
            "reason": "up to here rows in which a joint stands do not make a residual large at "
            "times only: dry friction holds it by a force that nothing tells. In motions about "
            "the wheels of one side, which stand all the time, they count",
        },
    )
    max_mean_over_median: float = field(
        default=4.0,
        metadata={
            "unit": "mean over median of the squares in blocks of time",
            "reason": "above it the residual lives at times only: noise of ten kinds has 1.0 to "
            "1.4, a bump and a sticky patch of the floor 7 to 27",
        },
    )
    episode_duration: float = field(
        default=1.0,
        metadata={
            "unit": "s",
            "reason": "of such a block: an outlier is gone within a filter's "
            "memory, what a floor does lasts longer",
        },
    )
    stretch_duration: float = field(
        default=6.0,
        metadata={
            "unit": "s",
            "reason": "of what is held out together: long against the memory of noise and filter",
        },
    )
    min_stretches: int = field(
        default=12,
        metadata={
            "unit": "1",
            "reason": "two a fold: logs that hold fewer are cut into shorter ones. Of a weight "
            "in 10 s of an axis two stretches of 6 s predicted nothing",
        },
    )
    min_stretch_duration: float = field(
        default=1.0,
        metadata={
            "unit": "s",
            "reason": "shorter ones are known from their neighbours: logs that hold fewer of these "
            "are too short to tell whether anything is missing",
        },
    )
    folds: int = field(
        default=6,
        metadata={"unit": "1", "reason": "each forest is grown on five sixths of the stretches"},
    )
    trees: int = field(
        default=24,
        metadata={"unit": "1", "reason": "40 change a share by less than 0.015"},
    )
    min_rows_of_leaf: int = field(
        default=20,
        metadata={
            "unit": "rows",
            "reason": "one second: with 5 rows, noise is predicted at -0.10 in place of -0.04, and "
            "shares of real effects are no larger",
        },
    )
    share_of_features: float = field(
        default=0.4,
        metadata={
            "unit": "share of the features that a split tries",
            "reason": "0.2 finds 0.10 less of a drive's lag",
        },
    )
    sign_width: float = field(
        default=0.03,
        metadata={
            "unit": "rms of the rate",
            "reason": "of a smoothed sign, for dry friction: 0.15 rad/s at usual wheel speeds",
        },
    )
    acceleration_smoothing_time: float = field(
        default=0.07,
        metadata={
            "unit": "s",
            "reason": "standard deviation of the mean: a quarter of a second takes the noise out "
            "that accelerations share with the residual, and leaves what a drive's lag needs",
        },
    )
    max_rows: int = field(
        default=8000,
        metadata={
            "unit": "1",
            "reason": "a bound on time: longer logs get fewer rows a second",
        },
    )
    min_likeness: float = field(
        default=0.6,
        metadata={
            "unit": "2 x y over x^2 + y^2",
            "reason": "of what two logs leave at the same time since each began, above which this "
            "is no wander: -0.31 to 0.37 for the wander of 36 pairs of logs, 0.65 to 1.00 for "
            "pushes in 18 that set in, or come and go, at one time",
        },
    )
    max_shift_p_value: float = field(
        default=0.05,
        metadata={
            "unit": "share of the shifts in time",
            "reason": "with which two logs are as much alike as without: a drift of hours is alike "
            "whatever the shift. With the likeness, 0 to 1.5 % of pairs that wander on their own "
            "pass (steps, walks, drifts, waves; 200 pairs each), 7.5 % of single waves of a log's "
            "length along one axis",
        },
    )
    likeness_step: float = field(
        default=1.0,
        metadata={"unit": "s", "reason": "of the shifts: finer than any offset wanders"},
    )
    likeness_mean: int = field(
        default=3,
        metadata={
            "unit": "steps",
            "reason": "of the running mean, which leaves a tenth of the squares of noise that "
            "does not last",
        },
    )
    measuring_margin: float = field(
        default=1.25,
        metadata={
            "unit": "1",
            "reason": "on what coarse channels alone make predictable, as the fitted model's own "
            "run has it, measured like the logs: the size of a count is known to 5 % or so, and "
            "five platforms with Coulomb friction and 500 to 4096 counts had 0.96 to 1.18 of it",
        },
    )
    max_share_of_values: float = field(
        default=0.1,
        metadata={
            "unit": "share of the samples",
            "reason": "a channel with fewer different values comes in steps",
        },
    )
    max_noise_of_step: float = field(
        default=0.5,
        metadata={
            "unit": "steps",
            "reason": "noise above it makes a step harmless (dither): the rounding is then noise, "
            "whatever the motion",
        },
    )
    rounded_bandwidth: float = field(
        default=10.0,
        metadata={
            "unit": "Hz",
            "reason": "of the torques that a model demands, in place of rounded ones: above the "
            "motions' 1 Hz and what a speed loop answers",
        },
    )
    noise_block_duration: float = field(
        default=5.0,
        metadata={
            "unit": "s",
            "reason": "of the blocks whose spread tells the noise's uncertainty: long against its "
            "memory",
        },
    )

    # Motions that repeat
    min_period: float = field(
        default=2.0,
        metadata={
            "unit": "s",
            "reason": "a shorter lag is no period: any slow motion resembles itself a little later",
        },
    )
    period_search_step: float = field(
        default=0.05,
        metadata={"unit": "s", "reason": "of the first search for a period; then each sample"},
    )
    max_period_difference: float = field(
        default=5e-4,
        metadata={
            "unit": "share of the motion's squares",
            "reason": "a motion that differs by more from one period to the next does not repeat: "
            "calibration motions of three simulators differ by 3e-5 to 8e-5, others by 1e-3 and "
            "more",
        },
    )

    @property
    def shortest(self) -> float:
        """What logs must last together [s], to tell whether anything is left."""
        return self.min_stretches * self.min_stretch_duration

    def stretch_in(self, duration: float) -> float:
        """Length of a stretch [s] that is held out of logs that last a duration [s] together."""
        shorter = max(duration / self.min_stretches, self.min_stretch_duration)
        return min(self.stretch_duration, shorter)

    def __post_init__(self) -> None:
        check_settings(self, "predictability settings", positive=True)
        if self.share_of_features > 1.0:
            raise InputError("predictability settings: share_of_features must be at most 1")


@dataclass(frozen=True)
class ChangingLawSettings(Settings):
    """How it is tested whether a residual follows a linear law that changes at an instant.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.
    """

    max_p_value: float = field(
        default=0.1,
        metadata={
            "unit": "1",
            "reason": "from the spread of what is gained in steps of time: keeps out what a few of "
            "them alone show. A load in half a minute of one log of two has 0.0002 to 0.07",
        },
    )
    min_share: float = field(
        default=0.08,
        metadata={
            "unit": "share of the residual's squares, held out",
            "reason": "as for trees: at most 0.004 in 880 sets of logs under noise that is white, "
            "remembers 0.1 to 10 s, walks, steps or swings in 10 to 100 s; 0.22 to 0.96 for loads, "
            "drives and frictions that change",
        },
    )
    instant_step: float = field(
        default=2.0,
        metadata={
            "unit": "s",
            "reason": "from one instant that is tried to the next: a third of a stretch",
        },
    )
    max_instants: int = field(
        default=72,
        metadata={"unit": "1", "reason": "a bound on time: of longer logs they are farther apart"},
    )
    min_duration: float = field(
        default=6.0,
        metadata={
            "unit": "s",
            "reason": "before and after the instant: a stretch that is held out",
        },
    )
    ridge: float = field(
        default=1e-3,
        metadata={
            "unit": "mean square of the signals",
            "reason": "what a stretch hardly shows of a law stays small",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "changing law settings", positive=True)


@dataclass(frozen=True)
class HarmonicScanSettings(Settings):
    """How it is tested whether a residual repeats over a place or a wheel's angle.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.
    """

    max_p_value: float = field(
        default=0.001,
        metadata={
            "unit": "1",
            "reason": "over all variables scanned; from the spread of what is gained in stretches",
        },
    )
    min_share: float = field(
        default=0.02,
        metadata={
            "unit": "share of the residual's squares, held out",
            "reason": "a wave that takes less is not worth a word",
        },
    )
    folds: int = field(
        default=4,
        metadata={"unit": "1", "reason": "a wave is chosen on three quarters of the stretches"},
    )
    stretch_duration: float = field(
        default=6.0,
        metadata={
            "unit": "s",
            "reason": "of what is held out together, as by the trees: long against the memory of "
            "noise and filter",
        },
    )
    min_stretches: int = field(
        default=8,
        metadata={"unit": "1", "reason": "two a fold; fewer say nothing of chance"},
    )
    min_periods: float = field(
        default=4.0,
        metadata={
            "unit": "periods in the usual range of a place",
            "reason": "longer waves are seen by trees and by smooth functions of the place, and "
            "slow noise imitates them: with 2, a torque that wanders had a share of 0.04",
        },
    )
    usual_range: tuple[float, float] = field(
        default=(0.02, 0.98),
        metadata={
            "unit": "quantile",
            "reason": "of the places, so that one excursion does not stretch the range",
        },
    )
    oversampling: float = field(
        default=3.0,
        metadata={
            "unit": "waves for each period more in the range",
            "reason": "a wave between two of them loses 9 % of its amplitude at most",
        },
    )
    max_waves: int = field(
        default=500,
        metadata={"unit": "1", "reason": "over one coordinate: a bound on time"},
    )
    fastest_in_time: float = field(
        default=1.5,
        metadata={
            "unit": "Hz",
            "reason": "of a force that swings in time: a grid's hum appears faster after sampling",
        },
    )
    min_periods_in_time: float = field(
        default=8.0,
        metadata={
            "unit": "periods in a log",
            "reason": "slow noise imitates the first waves of a log",
        },
    )
    max_periods_in_time: float = field(
        default=200.0,
        metadata={"unit": "periods in a log", "reason": "a bound on time"},
    )
    min_share_in_time: float = field(
        default=0.1,
        metadata={
            "unit": "share of a log's squares, held out",
            "reason": "noise of a narrow band has part of it; of a deck that sways it is most",
        },
    )
    max_share_of_nyquist: float = field(
        default=0.7,
        metadata={
            "unit": "share of half the rate of the rows",
            "reason": "at which a wave may pass at the usual speed; faster ones are averaged away",
        },
    )
    max_wheel_order: int = field(
        default=40,
        metadata={"unit": "cycles a turn", "reason": "up to which ripples are declared too"},
    )
    exact_waves: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "of the waves that lead in a fold, tried with the filter's exact response",
        },
    )
    sample_rate: float = field(
        default=50.0,
        metadata={
            "unit": "Hz",
            "reason": "at which waves are scanned: five times what the fastest of them passes at",
        },
    )
    samples_for_size: int = field(
        default=10,
        metadata={"unit": "1", "reason": "one of as many scanned samples tells a wave's size"},
    )
    waves_at_once: int = field(
        default=64,
        metadata={"unit": "1", "reason": "a bound on memory: 7 MB for 260 s"},
    )

    def __post_init__(self) -> None:
        check_settings(self, "harmonic scan settings", positive=True)


@dataclass(frozen=True)
class WheelEvidenceSettings(Settings):
    """How kinematics is judged by the wheels and a pose alone.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.
    """

    row_time: float = field(
        default=0.2,
        metadata={
            "unit": "s",
            "reason": "of a row: a mean over it leaves a fifth of the noise of 100 Hz, and what a "
            "wheel of another radius turns too much changes slowly",
        },
    )
    max_sample_rate: float = field(
        default=200.0,
        metadata={
            "unit": "Hz",
            "reason": "faster logs are averaged down to it, 40 samples a row: at 1 kHz the wheels "
            "took a third of the time of a whole identification",
        },
    )
    max_samples_at_once: int = field(
        default=32_768,
        metadata={
            "unit": "samples",
            "reason": "of which the slip is computed at once: more do not fit a processor's cache, "
            "and 20 minutes at 1 kHz took three times as long",
        },
    )
    min_duration: float = field(
        default=10.0,
        metadata={
            "unit": "s",
            "reason": "of a log that is judged: 50 rows, from which their noise can be told",
        },
    )
    min_noise: float = field(
        default=1e-9,
        metadata={
            "unit": "rad/s, of a row",
            "reason": "below any sensor's: so that logs without noise can be judged too",
        },
    )
    min_pose_noise: float = field(
        default=2e-5,
        metadata={
            "unit": "m and rad, of a row",
            "reason": "a pose without noise is no better than the trapezoids that it is compared "
            "with",
        },
    )
    steps: int = field(
        default=3,
        metadata={"unit": "1", "reason": "of Gauss and Newton: rates are nearly linear in errors"},
    )
    min_explained_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of the held-out squares of identity and pose",
            "reason": "that an effect of kinematics explains: 0.997 of one wheel 3 % larger; on a "
            "contact simulator, whose rollers ripple and slip, 0.42 at most of what is none",
        },
    )
    max_uncertain_share_of_creep: float = field(
        default=0.25,
        metadata={
            "unit": "share of what a creep moves the speeds by",
            "reason": "that a further effect of kinematics must exceed: where wheels creep by the "
            "force on the floor, and not by their torque, rollers that seem askew move them by "
            "0.16 to 0.18 of it, a speed that seems mis-scaled by 0.08",
        },
    )
    min_size_share: float = field(
        default=0.2,
        metadata={
            "unit": "catalogue size",
            "reason": "what is smaller does not matter to forces: 0.6 % of a radius",
        },
    )
    max_p_value: float = field(
        default=0.001,
        metadata={
            "unit": "1",
            "reason": "by the parameters' covariance, for five effects",
        },
    )
    max_seen_deviation: float = field(
        default=0.05,
        metadata={
            "unit": "catalogue size",
            "reason": "standard deviation up to which a direction of the parameters is settled by "
            "wheels and pose, and left alone by forces",
        },
    )
    max_tied_share: float = field(
        default=0.02,
        metadata={
            "unit": "share of what the best effect explains",
            "reason": "within which another one explains the wheels as well: a radius and a "
            "speed's gain differ by 1e-5, the next one by 0.3",
        },
    )

    min_slip_share: float = field(
        default=0.0065,
        metadata={
            "unit": "share of the wheel speeds",
            "reason": "that no rigid motion explains beyond noise, from which on wheels are said "
            "to slip: 0.004 of two contact simulators with a friction of 1, 0.0046 at 0.25, 0.0086 "
            "at 0.15, 0.05 where wheels slide; at most 0.002 of noise of any colour",
        },
    )
    swings_a_turn: tuple[int, ...] = field(
        default=(1, 2),
        metadata={
            "unit": "1",
            "reason": "of a speed with its wheel's angle: an encoder out of centre, an oval wheel",
        },
    )
    min_delay_eigenvalue: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the largest",
            "reason": "of the squares of what wheels break the rigid motion by where their speeds "
            "come late: the direction that is seen least, of the three that can be",
        },
    )
    min_rows_of_swing: int = field(
        default=4,
        metadata={
            "unit": "rows for each column",
            "reason": "of the half that swings are fitted to",
        },
    )
    min_share_of_swings: float = field(
        default=0.6,
        metadata={
            "unit": "share of the slip's squares, held out",
            "reason": "that swings, or delays, explain, above which they are named in place of "
            "slip: 0.98 of an encoder 4 % out of centre; 0.06 and less of wheels that slide on a "
            "floor with a friction of 0.1 and 0.15, and where one wheel is larger",
        },
    )
    min_share_of_largest_swing: float = field(
        default=0.5,
        metadata={
            "unit": "share of the largest swing",
            "reason": "from which on another wheel is named too",
        },
    )
    slip_deviations: float = field(
        default=4.0,
        metadata={
            "unit": "standard deviations of the noise of a row",
            "reason": "a row that slips by more, and by the share above, is left out where a "
            "friction must hold without slip",
        },
    )
    min_burst_share: float = field(
        default=0.015,
        metadata={
            "unit": "share of the usual wheel speed",
            "reason": "a row that slips by more is a burst, if the forces fail then: rollers that "
            "ripple reach it once to thrice a minute",
        },
    )
    min_rest_without_slip: float = field(
        default=0.3,
        metadata={
            "unit": "share of the samples",
            "reason": "with fewer that do not slip, nothing can be told without slip",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "kinematic settings", positive=True)

    def row_size(self, dt: float) -> int:
        """Samples of a row, where one comes every ``dt`` [s]: as many as come nearest to its time.

        What a row lasts is that many times ``dt``, and that is ``row_time`` only where it divides.
        """
        return max(1, round(self.row_time / dt))


@dataclass(frozen=True)
class LateEffortSettings(Settings):
    """How it is judged that efforts of some joints were logged later than the others'.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.
    """

    max_sample_rate: float = field(
        default=200.0,
        metadata={
            "unit": "Hz",
            "reason": "faster logs are averaged down to it: a delay that matters is 5 ms and more",
        },
    )
    smooth_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of a joint's usual speed",
            "reason": "over which dry friction turns its sign, as in the catalogue's frictions",
        },
    )
    min_rows: float = field(
        default=10.0,
        metadata={"unit": "numbers for each column", "reason": "with fewer a fit is no evidence"},
    )
    max_steps: int = field(
        default=12,
        metadata={
            "unit": "1",
            "reason": "of Gauss and Newton: from 0 to 80 ms it takes 3; where it takes more, no "
            "delay is what is there",
        },
    )
    min_eigenvalue: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the largest",
            "reason": "of the squares that delays explain, along the direction that the motion "
            "shows least: 0.1 and more where all wheels turn",
        },
    )
    min_power: float = field(
        default=1e-6,
        metadata={
            "unit": "share of the squares of a delay's columns",
            "reason": "that must be left beyond what the model knows: of a model that has a lag "
            "nothing is left of a delay that all efforts share",
        },
    )
    max_delay: float = field(
        default=0.5,
        metadata={"unit": "s", "reason": "beyond, no logger is so late, and something else acts"},
    )
    min_delay: float = field(
        default=0.01,
        metadata={
            "unit": "s",
            "reason": "a shorter one changes no parameter by more than its interval",
        },
    )
    min_deviations: float = field(
        default=5.0,
        metadata={
            "unit": "standard deviations",
            "reason": "of the delay between the two groups of efforts, which are chosen for it",
        },
    )
    max_spread: float = field(
        default=0.5,
        metadata={
            "unit": "share of the delay",
            "reason": "by which efforts of one group may differ: where each comes at another time, "
            "no logger is the reason",
        },
    )
    min_share_of_rest: float = field(
        default=0.5,
        metadata={
            "unit": "share of the squares beyond noise",
            "reason": "that the delay must explain of what a common one leaves",
        },
    )
    min_fall: float = field(
        default=0.01,
        metadata={
            "unit": "share of the squares",
            "reason": "that the delay must explain in any case: what is less is lost in noise, and "
            "no parameter would be wrong by it",
        },
    )
    max_noise: float = field(
        default=1.5,
        metadata={
            "unit": "share of the squares",
            "reason": "that white noise may be said to leave: 1.1 where it is white, 6 to 14 of "
            "counted speeds, which are smoothed",
        },
    )
    noise_draws: int = field(
        default=4,
        metadata={"unit": "1", "reason": "of the noise: its squares are known to 2 % a minute"},
    )
    max_part_of_sample: float = field(
        default=0.75,
        metadata={
            "unit": "samples",
            "reason": "that the rates may stand for, the rest are whole samples: above a half, so "
            "that a delay between two samples does not go to and fro",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "settings of late efforts", positive=True)


@dataclass(frozen=True)
class FitSettings(Settings):
    """What a fit, its intervals, the errors of a model and their noise floors depend on.

    Each field's ``metadata`` holds its unit and the reason, or the measurement, for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive, or a share is not below 1.
    """

    filter: FilterSettings = field(default_factory=FilterSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    held: HeldSettings = field(default_factory=HeldSettings)
    mechanism: MechanismSettings = field(default_factory=MechanismSettings)
    predictability: PredictabilitySettings = field(default_factory=PredictabilitySettings)
    changing_law: ChangingLawSettings = field(default_factory=ChangingLawSettings)
    harmonic_scan: HarmonicScanSettings = field(default_factory=HarmonicScanSettings)
    kinematics: WheelEvidenceSettings = field(default_factory=WheelEvidenceSettings)
    late_efforts: LateEffortSettings = field(default_factory=LateEffortSettings)

    # When a log began on the clock of an effect that swings
    clock_harmonics: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "of a force that repeats itself in time: laws of one have one, and what a "
            "pendulum does at large swings has hardly more",
        },
    )
    clock_steps: int = field(
        default=3600,
        metadata={"unit": "1 a period", "reason": "0.1 degrees apart: less than noise leaves"},
    )
    shown_starts: int = field(
        default=4,
        metadata={"unit": "1", "reason": "logs whose starts a sentence names: what one reads"},
    )
    min_clock_share: float = field(
        default=1e-9,
        metadata={
            "unit": "share of the squares",
            "reason": "by which they differ over the period, or the effect does not act: rounding",
        },
    )

    # Rows of the regression
    row_rate: float = field(
        default=20.0,
        metadata={"unit": "1/s", "reason": "2 a_f: the filter leaves little above"},
    )
    rows_per_filter_rate: float = field(
        default=2.0,
        metadata={
            "unit": "rows per rad",
            "reason": "least rows a second over the rate of a mechanism's own filter: an axis may "
            "be filtered at 100 rad/s, and rows at 20/s hid most of that (EMPS, three effects: "
            "official error 2.17 % at 20/s, 2.06 at 200/s; a delay's deviation 0.06, 0.02 ms)",
        },
    )
    min_rows_per_parameter: float = field(
        default=2.0,
        metadata={
            "unit": "1",
            "reason": "with fewer rows the residual says little of its own size",
        },
    )

    # Gauss-Newton steps
    max_steps: int = field(
        default=30,
        metadata={"unit": "1", "reason": "a bound on time: a model that is linear takes one"},
    )
    max_converged_square_share: float = field(
        default=1e-9,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "a last step that moves the prediction by less is, with 10^4 rows, some "
            "thousandths of a standard deviation",
        },
    )
    min_fall_share: float = field(
        default=1e-5,
        metadata={
            "unit": "share of the squares",
            "reason": "a parameter that the data hardly show (a breakaway peak that is not there, "
            "the place of a load without mass) wanders about and gains less",
        },
    )
    max_steps_without_fall: int = field(
        default=4,
        metadata={"unit": "1", "reason": "the squares may rise for a step or two and fall again"},
    )
    max_square_ratio: float = field(
        default=100.0,
        metadata={
            "unit": "1",
            "reason": "squares over the least so far from which on a step has gone too far",
        },
    )
    step_shares: tuple[float, ...] = field(
        default=(1.0, 0.5, 0.25, 0.125, 0.03125),
        metadata={
            "unit": "share of a step",
            "reason": "tried in turn until the squares fall: on the EMPS data full steps in the "
            "knee of a friction beside a delay raised them from 288 to 361, half of one lowered "
            "them",
        },
    )
    huber_threshold: float = field(
        default=1.345,
        metadata={
            "unit": "robust standard deviations",
            "reason": "95 % efficient on clean Gaussian residuals (Huber 1964)",
        },
    )
    min_singular_value_share: float = field(
        default=1e-12,
        metadata={
            "unit": "share of the largest singular value",
            "reason": "rounding: what a step cannot see stays where it is",
        },
    )
    unseen_weight_share: float = field(
        default=10.0,
        metadata={
            "unit": "share of the columns' norm",
            "reason": "holds what no data can see where a bound acts: offsets of torques that "
            "exert no force went to 2.8e10 N m with none. The common part of four gains moves "
            "along with all masses: with 1e-4 a fit left them at 1.5 and a mass of 47 kg in place "
            "of 34; with 1 and more at 0.000, and the squares are the same",
        },
    )

    # Limits of what can be
    limit_room: float = field(
        default=1e-6,
        metadata={
            "unit": "parameters' sizes",
            "reason": "a fit that is pulled beyond a limit stops as far within: above the rounding "
            "of a model file",
        },
    )
    limit_steps: int = field(
        default=200,
        metadata={"unit": "1", "reason": "a bound on time: some 20 are needed"},
    )
    limit_halvings: int = field(
        default=60,
        metadata={"unit": "1", "reason": "halve a way down to the rounding of a number"},
    )

    # Covariance and intervals
    min_correlation_time: float = field(
        default=0.5,
        metadata={
            "unit": "s",
            "reason": "least window over which scores may be correlated beyond AR(1) memory",
        },
    )
    max_residual_memory: float = field(
        default=0.97,
        metadata={
            "unit": "1",
            "reason": "prewhitening with a memory near 1 would blow up (Andrews and Monahan 1992)",
        },
    )
    max_score_memory: float = field(
        default=0.95,
        metadata={
            "unit": "1",
            "reason": "keeps the plug-in bandwidth finite (Andrews 1991)",
        },
    )
    min_information_share: float = field(
        default=1e-13,
        metadata={
            "unit": "share of the largest eigenvalue",
            "reason": "rounding: directions with less information have no covariance",
        },
    )
    stretch_time: float = field(
        default=20.0,
        metadata={
            "unit": "s",
            "reason": "of the stretches whose scores' spread may be the variance: four periods of "
            "a calibration motion. It raises standard deviations by 70 % where a tilt and a dry "
            "friction are missing or rollers are real",
        },
    )
    stretch_level: float = field(
        default=0.1,
        metadata={
            "unit": "1",
            "reason": "chance that a true model's spread counts. One calibration motion with "
            "offsets that wander: intervals of 95 % held 82 % without, 93 % with it; white noise "
            "no change",
        },
    )
    min_stretches: int = field(
        default=4,
        metadata={"unit": "1", "reason": "the spread of fewer is hardly ever beyond chance"},
    )
    interval_deviations: float = field(
        default=1.96,
        metadata={
            "unit": "standard deviations",
            "reason": "either side of a value: they hold a Gaussian truth in 95 % of cases",
        },
    )
    max_change_p_value: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "family-wise over all parameters of a model, up to which one counts as "
            "changed since the model was made",
        },
    )
    max_misfit_growth: float = field(
        default=2.0,
        metadata={
            "unit": "times the misfit of the given model on its own logs",
            "reason": "of a refitted model, up to which a parameter may be said to have changed: "
            "on rolling contacts both are 1.2, with a payload of 5 kg too; under a carpet's nap, "
            "which no model holds, it was 10, and mu1 'had risen' by 0.019 +- 0.004 N m s",
        },
    )

    # Observability
    blind_eigenvalue: float = field(
        default=3e-3,
        metadata={
            "unit": "1",
            "reason": "of the Gramian of unit columns, whose mean is 1: a direction with less is "
            "blind; its standard deviation is 18 times that of orthogonal columns",
        },
    )
    refused_eigenvalue: float = field(
        default=1e-3,
        metadata={
            "unit": "1",
            "reason": "of the same Gramian, under which no model is fitted: from 1e-3 to 3e-3 the "
            "interval is wide and says so. A platform whose torques were cut at 0.6 N m hardly "
            "moved, and had 2.7e-3 with all motions driven",
        },
    )
    ideal_blind_eigenvalue: float = field(
        default=1e-9,
        metadata={
            "unit": "1",
            "reason": "the same for an ideal motion: only rounding stands between blind and seen",
        },
    )
    min_column_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the longest column",
            "reason": "noise alone gives every column some length: shorter ones count as noise",
        },
    )
    min_coupling: float = field(
        default=0.1,
        metadata={
            "unit": "cosine between two columns",
            "reason": "from here on their parameters belong to one block",
        },
    )
    min_direction_share: float = field(
        default=0.15,
        metadata={
            "unit": "1",
            "reason": "parameters with less of a blind unit vector are not named, nor their "
            "estimates withheld",
        },
    )

    max_separate_share: float = field(
        default=0.05,
        metadata={
            "unit": "standard deviation over value",
            "reason": "beyond, a parameter counts as not separated from its fellows: I1 has 0.02 "
            "on good logs of a platform, 0.2 where rollers are real",
        },
    )
    min_combination_gain: float = field(
        default=2.0,
        metadata={
            "unit": "1",
            "reason": "relative deviation of the best known member over that of a sum that is "
            "worth telling: 2.8 and 4.7 where rollers are real",
        },
    )

    # Bias by noise on the speeds
    max_shape_square_ratio: float = field(
        default=1.001,
        metadata={
            "unit": "1",
            "reason": "squares over those at the searched shapes from which on the joint fit of "
            "shapes has gone astray",
        },
    )
    min_noise_scatter: float = field(
        default=3.0,
        metadata={
            "unit": "standard deviations",
            "reason": "scatter by noise on the speeds that is added to the residual's: noise on an "
            "integrated wheel angle stays, and no short memory tells of it",
        },
    )
    noise_scatter_draws: int = field(
        default=8,
        metadata={"unit": "1", "reason": "tell the scatter's size to a quarter of it"},
    )

    max_difference_of_twins: float = field(
        default=1e-6,
        metadata={
            "unit": "1, less the cosine of two columns",
            "reason": "up to which two parameters of an effect act alike: noise hides far more",
        },
    )
    max_noise_shift: float = field(
        default=6.0,
        metadata={
            "unit": "standard deviations",
            "reason": "by which noise on the speeds may bias a force fit. Beyond, the free run is "
            "fitted: simulation and extrapolation left 0.7 of 5.6, but 7 of 11",
        },
    )

    # Channels that hold each value for some rows
    max_start_steps: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "Gauss-Newton from catalogue sizes to a theta whose inertia makes the right "
            "ripple; the centre of mass is a quotient, so one step is not enough",
        },
    )
    max_late_ripple: float = field(
        default=0.35,
        metadata={
            "unit": "share of the speeds' ripple",
            "reason": "that a drive would leave which holds its efforts as logged. Efforts that "
            "a slow logger held left 0.04 to 0.23 (holds of 20 to 100 ms, three times the noise)",
        },
    )
    min_held_ripple: float = field(
        default=0.6,
        metadata={
            "unit": "share of the speeds' ripple",
            "reason": "drives that really hold their efforts left 0.94 to 1.03; between the two "
            "it stays open, and both fits are inside the intervals",
        },
    )

    # Output error
    output_error_max_steps: int = field(
        default=12,
        metadata={"unit": "1", "reason": "a bound on time: each costs free runs of all logs"},
    )
    output_error_min_fall_share: float = field(
        default=1e-5,
        metadata={
            "unit": "share of the squares",
            "reason": "the search stops when a step lowers the squares by less",
        },
    )
    output_error_max_old_columns_fall: float = field(
        default=0.01,
        metadata={
            "unit": "share of the squares",
            "reason": "a step that lowers the squares by less keeps the columns of the last one: "
            "they lead to within a tenth of a standard deviation in less than half the time",
        },
    )
    output_error_step_shares: tuple[float, ...] = field(
        default=(1.0, 0.5, 0.25, 0.125),
        metadata={
            "unit": "share of a step",
            "reason": "tried in turn until the squares fall",
        },
    )
    output_error_scaled_difference: float = field(
        default=1e-4,
        metadata={
            "unit": "N m",
            "reason": "least change of a scaled parameter for a central difference of free runs: "
            "far above their rounding",
        },
    )
    output_error_relative_difference: float = field(
        default=1e-5,
        metadata={"unit": "share of the parameter", "reason": "the same for large parameters"},
    )

    # Force error and noise floor
    max_floor_samples: int = field(
        default=30_000,
        metadata={
            "unit": "samples",
            "reason": "tell a floor to better than 2 %; a longer log's is scaled up from them",
        },
    )

    # Cross-validation
    blocks_of_single_log: int = field(
        default=5,
        metadata={
            "unit": "1",
            "reason": "a log that alone shows something is cut into as many, to hold one out",
        },
    )
    min_lone_share: float = field(
        default=0.9,
        metadata={
            "unit": "share of a column's squares",
            "reason": "from here on the log that they lie in alone shows the column",
        },
    )
    min_lone_share_of_combination: float = field(
        default=0.99,
        metadata={
            "unit": "share of the squares of a combination of columns",
            "reason": "from here on one log alone shows it, and without it a linear step goes ten "
            "deviations astray: 0.9999 of drives that get warm over three logs, where held-out "
            "squares rose to 30 times those without it; 0.78 of most effects, 0.96 of a spring",
        },
    )
    min_lasting_noise_ratio: float = field(
        default=1.05,
        metadata={
            "unit": "what the speeds hold beside any motion, over their white noise",
            "reason": "from here on, and below its inverse, noise of the speeds is not white: "
            "0.985 to 1.008 of white noise in 30 logs; 1.14 to 7.8 of a first-order noise in 34, "
            "in all of which a resonance had p = 0.01 or less by white noise alone, and in one by "
            "their own; 0.6 of a hum near half the sampling rate",
        },
    )
    noise_band_width: float = field(
        default=0.5,
        metadata={
            "unit": "Hz",
            "reason": "of a band of frequencies in which the power of torque noise is sought, at "
            "most: a hum lies in one, and what a drive makes of it hardly changes within it",
        },
    )
    noise_band_share: float = field(
        default=0.25,
        metadata={
            "unit": "share of its frequency",
            "reason": "of a band's width at low frequencies, where slow noise changes most",
        },
    )
    noise_band_frequencies: int = field(
        default=8,
        metadata={
            "unit": "1",
            "reason": "least number of frequencies in a band: on three axes their power is known "
            "to 20 %",
        },
    )
    noise_band_deviations: float = field(
        default=3.0,
        metadata={
            "unit": "standard deviations of a band's power",
            "reason": "by which it must differ from that of white noise: of 70 bands one differs "
            "more by chance in one of five logs of white noise",
        },
    )
    min_held_out_share: float = field(
        default=1e-10,
        metadata={
            "unit": "share of the largest eigenvalue",
            "reason": "rounding of normal equations: what the other folds cannot see stays at zero",
        },
    )

    # Long logs
    max_samples: int = field(
        default=720_000,
        metadata={
            "unit": "samples of all logs together",
            "reason": "of about twice as many, faster logs are averaged down: an hour at 1 kHz to "
            "200 Hz, with less noise on the regressors. It took 87 s, and every deviation was "
            "twice as large; 20 minutes at 1 kHz stay as they are",
        },
    )
    min_sample_rate: float = field(
        default=200.0,
        metadata={
            "unit": "Hz",
            "reason": "no log is averaged below it: a drive that swings at 30 Hz lies well below",
        },
    )
    max_part_samples: int = field(
        default=120_000,
        metadata={
            "unit": "samples",
            "reason": "of a log that are turned into regression rows at once: 0.1 GB; two minutes "
            "at 1 kHz, so that most logs are one part",
        },
    )
    part_samples: int = field(
        default=40_000,
        metadata={
            "unit": "samples",
            "reason": "in each part of a longer log: what is made of them takes 50 MB, and the "
            "margins of a part at 1 kHz a fifth of its time",
        },
    )
    part_margin_time_constants: float = field(
        default=37.0,
        metadata={
            "unit": "1/a_f",
            "reason": "that a part of a long log begins before its first row: exp(-37) is rounding",
        },
    )

    # Recursive least squares
    recursive_prior_variance: float = field(
        default=1e6,
        metadata={
            "unit": "(N m)^2",
            "reason": "of the scaled parameters, far above any: the start is forgotten",
        },
    )
    recursive_forgetting: float = field(
        default=1.0,
        metadata={
            "unit": "1 a row",
            "reason": "1 keeps all rows, so that the course ends at the batch estimate",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "fit settings", positive=True)
        shares = (
            "max_residual_memory",
            "max_score_memory",
            "stretch_level",
            "min_lone_share",
            "min_lone_share_of_combination",
        )
        for name in shares:
            if getattr(self, name) >= 1.0:
                raise InputError(f"fit settings: {name} must be below 1")
        if self.recursive_forgetting > 1.0:
            raise InputError("fit settings: recursive_forgetting must be at most 1")

    def rows_of(self, filter_rate: float, dt: float) -> RowFilter:
        """How samples ``dt`` [s] apart become rows, through a filter of some rate [rad/s]."""
        rate = max(self.row_rate, self.rows_per_filter_rate * filter_rate)
        size = max(1, round(1.0 / (rate * dt)))
        return RowFilter(filter_rate, self.filter.settling_time_constants, dt, size)
