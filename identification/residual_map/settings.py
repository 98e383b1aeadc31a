"""All numbers that somebody chose for the residual map, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class ResidualMapSettings(Settings):
    """What the shares and curves of a residual map depend on.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    # What is told
    min_duration: float = field(
        default=20.0,
        metadata={
            "unit": "s",
            "reason": "shorter logs hold too few independent stretches to tell anything",
        },
    )
    min_telling_duration: float = field(
        default=60.0,
        metadata={
            "unit": "s",
            "reason": "where shorter logs show no share beside a large error, they are too short "
            "to tell: a share of 30 s rests on 15 blocks, few of which are held out at a time",
        },
    )
    max_p_value: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "family-wise: of a hundred maps of sound models one shows a share that "
            "chance made",
        },
    )
    max_p_value_with_a_law: float = field(
        default=0.05,
        metadata={
            "unit": "1",
            "reason": "of variables that a rule or a law depends on too, which have been judged on "
            "stretches of their own: what acts in one corner of the floor is a few blocks, and "
            "signs of these are often enough alike by chance",
        },
    )
    min_share_of_residual: float = field(
        default=0.01,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "smaller shares may be significant in long logs, but are not relevant",
        },
    )

    log_stretch: float = field(
        default=6.0,
        metadata={
            "unit": "s",
            "reason": "of each log that is held out together, where it is asked what differs "
            "between logs: as where it is asked whether anything can be predicted",
        },
    )
    stretch_folds: int = field(
        default=4,
        metadata={
            "unit": "1",
            "reason": "of stretches of that length, held out in turn: each time three quarters of "
            "the floor's places are known",
        },
    )
    min_stretch_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "of what is told by stretches alone, which lie between known ones in time: "
            "noise that wanders reached 0.07 (of 13 logs without anything), laws of the floor "
            "0.12 and more",
        },
    )
    min_log_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "of the log or the shared time: logs of different motions differ a little "
            "wherever a model is not exact",
        },
    )

    # Bootstrap
    bootstrap_block_time: float = field(
        default=2.0,
        metadata={
            "unit": "s",
            "reason": "20/a_f: residuals this far apart are independent; the block length of every "
            "bootstrap and of the standard errors between candidates",
        },
    )
    bootstrap_draws: int = field(
        default=499,
        metadata={
            "unit": "1",
            "reason": "a p-value of 1 % then rests on the five largest draws",
        },
    )
    null_tail_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the draws",
            "reason": "the mean of a variable's largest draws is the unit of its gain: steadier "
            "than one quantile",
        },
    )
    min_null_share_of_residual: float = field(
        default=0.001,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "least unit of a gain: shares of this order are within chance, however long "
            "the logs",
        },
    )

    # Regression
    ridge_strengths: tuple[float, ...] = field(
        default=(1e-3, 1e-2, 1e-1, 1.0, 10.0),
        metadata={
            "unit": "1 a row",
            "reason": "for features of unit size, from hardly any shrinkage to nearly all; the "
            "one that does best on held-out rows is taken",
        },
    )
    fitted_wheel_orders: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "of a wheel's angle only the orders that are strongest in the training part "
            "are fitted",
        },
    )

    # Rows
    max_sample_rate: float = field(
        default=100.0,
        metadata={
            "unit": "Hz",
            "reason": "faster logs are averaged down to it; a ripple of 120 rad/s still lies well "
            "below",
        },
    )
    max_row_rate: float = field(
        default=50.0,
        metadata={
            "unit": "1/s",
            "reason": "more than the filter leaves of a motion, for the ripple of a fast wheel",
        },
    )
    max_rows: int = field(
        default=60_000,
        metadata={
            "unit": "1",
            "reason": "longer logs get fewer rows a second, so that memory stays bounded",
        },
    )
    max_part_samples: int = field(
        default=15_000,
        metadata={
            "unit": "samples",
            "reason": "of a log of which features are made at once: 150 s at that rate, 0.1 GB",
        },
    )
    smoothing_rate: float = field(
        default=20.0,
        metadata={
            "unit": "rad/s",
            "reason": "of the filter, forwards and backwards, ahead of products and jerks: 2 a_f",
        },
    )

    # Features
    step_widths: tuple[float, ...] = field(
        default=(0.006, 0.04, 0.25),
        metadata={
            "unit": "rms of the rate",
            "reason": "of smoothed signs, for dry friction: with 5 rad/s at the wheels 0.03, 0.2 "
            "and 1.25 rad/s",
        },
    )
    max_wheel_order: int = field(
        default=24,
        metadata={
            "unit": "cycles a turn",
            "reason": "up to which a wheel's angle is searched",
        },
    )
    rubbing_wheel_orders: int = field(
        default=4,
        metadata={
            "unit": "cycles a turn",
            "reason": "up to which a friction may swing with a wheel's angle: once, where it is "
            "not round, up to the number of its spokes",
        },
    )
    max_heading_harmonic: int = field(
        default=3,
        metadata={
            "unit": "periods a turn",
            "reason": "of forces fixed in the world; a slope has one",
        },
    )
    friction_directions: int = field(
        default=8,
        metadata={
            "unit": "1",
            "reason": "world directions, over half a turn, along which a dry force may act: 22.5 "
            "degrees apart",
        },
    )
    position_knots: int = field(
        default=6,
        metadata={
            "unit": "1",
            "reason": "ends of the ramps over the range of places: five pieces of equal width",
        },
    )
    usual_places: tuple[float, float] = field(
        default=(0.02, 0.98),
        metadata={
            "unit": "quantile",
            "reason": "the ramps lie between them, so that one excursion does not stretch all",
        },
    )
    time_knots: tuple[float, ...] = field(
        default=(0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
        metadata={
            "unit": "share of the longest log",
            "reason": "ends of the ramps over time: dense at the start, where something warms up",
        },
    )

    # Curves
    curve_points: int = field(
        default=16,
        metadata={
            "unit": "1",
            "reason": "of a curve over one variable",
        },
    )
    curve_range: tuple[float, float] = field(
        default=(0.005, 0.995),
        metadata={
            "unit": "quantile",
            "reason": "of its variable that a curve spans, so that rare values do not stretch it",
        },
    )
    min_share_of_rows: float = field(
        default=0.004,
        metadata={
            "unit": "share of the rows",
            "reason": "a point of a curve that fewer rows support is not shown",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "residual map settings", positive=True)


@dataclass(frozen=True)
class RegimeSettings(Settings):
    """How it is found where a residual lives.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    bins: int = field(
        default=16,
        metadata={
            "unit": "1",
            "reason": "of a column, between which a rule may cut: 6 % of the rows each",
        },
    )
    fine_bins: int = field(
        default=12,
        metadata={"unit": "1", "reason": "between the neighbours of an end: 1 % of the rows each"},
    )
    max_distance_from_zero: float = field(
        default=0.3,
        metadata={
            "unit": "standard deviations of the speed",
            "reason": "an end this near to standstill is standstill: the filter remembers what was "
            "on the other side for 0.3 s, and a wheel turns back by as much",
        },
    )
    filter_memory: float = field(
        default=0.3,
        metadata={
            "unit": "s",
            "reason": "three time constants of the filter, after which 5 % of a force are left",
        },
    )
    min_outside_information: float = field(
        default=1e-3,
        metadata={
            "unit": "share of the information of all rows",
            "reason": "on a parameter, with less of which the rows outside of a rule do not move "
            "it: rows without motion would fit anything",
        },
    )
    max_logs_for_pairs: int = field(
        default=4,
        metadata={"unit": "1", "reason": "up to here two logs together are a rule: a bound on it"},
    )
    rectangle_rounds: int = field(
        default=3,
        metadata={"unit": "1", "reason": "in which both sides of a place are sought in turn"},
    )
    stretch_duration: float = field(
        default=6.0,
        metadata={
            "unit": "s",
            "reason": "of what is left out together: as where it is asked whether anything can be "
            "predicted",
        },
    )
    judged_rules: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "likeliest rules that are tried on stretches left out: later ones describe "
            "the same rows worse",
        },
    )
    min_square_ratio: float = field(
        default=2.5,
        metadata={
            "unit": "mean square inside over that outside, held out",
            "reason": "noise of ten kinds differs by less than 1.4 between blocks of time",
        },
    )
    max_outside_over_noise: float = field(
        default=1.25,
        metadata={
            "unit": "mean square outside over that of noise, held out",
            "reason": "with more there it does not live inside: 0.01 to 0.5 of what trees leave as "
            "noise for a patch, a bump, one direction of a wheel, since a time; 1.6 to 15 for "
            "forces that act everywhere and are larger somewhere (a line spring, a drift)",
        },
    )
    min_share_inside: float = field(
        default=0.75,
        metadata={
            "unit": "share of the squares beyond noise, held out",
            "reason": "where more lies outside, the rule is not where it lives. The filter's "
            "memory of what was inside is outside too",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "regime settings", positive=True)
