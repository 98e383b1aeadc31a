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
    max_p_value: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "family-wise: of a hundred maps of sound models one shows a share that "
            "chance made",
        },
    )
    min_share_of_residual: float = field(
        default=0.01,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "smaller shares may be significant in long logs, but are not relevant",
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
