"""Numbers that the residual map depends on, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


def setting(default: Any, unit: str, reason: str) -> Any:
    """A field of a settings dataclass: its default, unit ("-" for none) and why that value."""
    return field(default=default, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class ResidualMapSettings:
    """Settings of :func:`identification.residual_map.residual_map.residual_map`."""

    # What is told
    min_duration_s: float = setting(
        20.0, "s", "logs that are shorter in all hold too few independent blocks to tell anything"
    )
    max_p_value: float = setting(
        0.01, "-", "family-wise: one map of a sound model in a hundred shows a share by chance"
    )
    min_share_of_residual: float = setting(
        0.01, "-", "smaller shares may be significant in long logs, but nobody would act on them"
    )

    # Cross-validation and bootstrap
    folds_of_single_log: int = setting(
        5, "-", "contiguous parts of a log that is alone, so that something can be held out"
    )
    block_duration_s: float = setting(
        2.0, "s", "20 time constants of the force filter: residuals further apart are independent"
    )
    bootstrap_draws: int = setting(
        499, "-", "a p-value of 1 % then rests on the five largest draws"
    )
    null_tail_share: float = setting(
        0.05, "-", "the mean of this share of a variable's largest draws is the unit of its gain: "
        "steadier than one quantile of few draws"
    )  # fmt: skip
    min_null_share_of_residual: float = setting(
        0.001, "-", "least unit of a gain, so that tiny gains in long logs count for little"
    )

    # Regression
    ridge_strengths: tuple[float, ...] = setting(
        (1e-3, 1e-2, 1e-1, 1.0, 10.0), "1/row", "from hardly any shrinkage of a feature of unit "
        "size to nearly all; the one that does best on held-out rows is taken"
    )  # fmt: skip
    max_orders: int = setting(
        3, "-", "orders of a wheel's angle that are fitted, the strongest in the training part"
    )

    # Rows
    max_sample_rate_hz: float = setting(
        100.0, "Hz", "faster logs are averaged down; a ripple of 120 rad/s lies well below it"
    )
    max_row_rate_hz: float = setting(
        50.0, "Hz", "more than the filter leaves of a motion, for the ripple of a fast wheel"
    )
    max_rows: int = setting(
        60_000, "-", "longer logs get fewer rows a second, so that memory stays bounded"
    )
    smoothing_rate_rad_s: float = setting(
        20.0, "rad/s", "filter ahead of products and jerks, run forwards and backwards: twice the "
        "force filter's rate"
    )  # fmt: skip

    # Features
    step_widths: tuple[float, ...] = setting(
        (0.006, 0.04, 0.25), "rms rate", "smoothed signs for dry friction: with 5 rad/s at the "
        "wheels 0.03, 0.2 and 1.25 rad/s"
    )  # fmt: skip
    max_wheel_order: int = setting(
        24, "1/turn", "cycles per turn up to which a wheel's angle is searched"
    )
    max_heading_harmonic: int = setting(
        3, "1/turn", "forces with one, two and three periods a turn; a slope has one"
    )
    friction_directions: int = setting(
        8, "-", "world directions over half a turn along which a dry force may act: 22.5 degrees "
        "apart"
    )  # fmt: skip
    position_knots: int = setting(
        6, "-", "ends of the ramps over the range of places: five pieces of equal width"
    )
    usual_places: tuple[float, float] = setting(
        (0.02, 0.98), "quantile", "the ramps span these, so that one excursion stretches nothing"
    )
    time_knots: tuple[float, ...] = setting(
        (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0), "longest log",
        "ends of the ramps over time: dense at the start, where something warms up"
    )  # fmt: skip

    # Curves
    curve_points: int = setting(16, "-", "points of a curve")
    curve_range: tuple[float, float] = setting(
        (0.005, 0.995), "quantile", "a curve spans these values of its variable"
    )
    min_share_of_rows: float = setting(0.004, "-", "a point that fewer rows support is not shown")
