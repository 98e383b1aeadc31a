"""All numbers that somebody chose for the search of a law, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class ProposalSettings(Settings):
    """What a proposal depends on.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    # Grammar: where the search for shape constants begins
    directions: int = field(
        default=12,
        metadata={
            "unit": "1 a half turn",
            "reason": "15 degrees apart: of a dry force along a direction half way between two, "
            "each shows 98 %",
        },
    )
    quarters: int = field(
        default=6,
        metadata={
            "unit": "1 a quarter turn",
            "reason": "directions of a friction along and across: 15 degrees apart as above",
        },
    )
    knee_shares: tuple[float, ...] = field(
        default=(0.25, 0.8, 1.6),
        metadata={"unit": "share of a speed's rms", "reason": "where a shape may bend"},
    )
    peak_shares: tuple[float, ...] = field(
        default=(0.3, 0.8, 1.3, 1.8),
        metadata={"unit": "share of a speed's rms", "reason": "where friction may have a peak"},
    )
    width_shares: tuple[float, ...] = field(
        default=(0.15, 0.4),
        metadata={"unit": "share of a speed's rms", "reason": "how wide such a peak may be"},
    )
    edges: int = field(
        default=7,
        metadata={
            "unit": "1",
            "reason": "places of a step or ramp, at quantiles of where the mechanism has been",
        },
    )
    instants: int = field(
        default=15,
        metadata={"unit": "1 a log", "reason": "of a step in time, 4 s apart in a minute"},
    )
    spot_spacing: float = field(
        default=0.8,
        metadata={
            "unit": "radii",
            "reason": "between centres of patches and bumps: the farthest place is 0.57 radii from "
            "one, where a patch of the same size still covers two thirds of it",
        },
    )
    spot_radii: tuple[float, ...] = field(
        default=(0.12, 0.25, 0.5),
        metadata={"unit": "m", "reason": "of patches and bumps: each twice the one before"},
    )
    max_spots: int = field(
        default=120,
        metadata={
            "unit": "1 a radius",
            "reason": "a bound on time; those where most is left unexplained",
        },
    )
    spot_radius_shares: tuple[float, ...] = field(
        default=(0.7, 1.0, 1.4, 2.0, 2.8),
        metadata={
            "unit": "radii of the bump that found it",
            "reason": "of a patch of another shape: a spring that ends at r_0 looks like a bump "
            "whose push is largest at 0.5 to 0.8 r_0",
        },
    )
    spot_offset: float = field(
        default=0.5,
        metadata={
            "unit": "radii of the bump that found it",
            "reason": "between the middles that are tried of a patch of another shape",
        },
    )
    heading_orders: tuple[int, ...] = field(
        default=(1, 2, 3, 4),
        metadata={"unit": "1 a turn", "reason": "of forces periodic in the heading"},
    )
    strip_half_widths: tuple[float, ...] = field(
        default=(0.15, 0.4),
        metadata={"unit": "m", "reason": "of a strip of floor: a door mat's and a runner's half"},
    )
    line_directions: int = field(
        default=6,
        metadata={
            "unit": "1 a half turn",
            "reason": "across oblique lines: 30 degrees apart, from where a search goes on",
        },
    )
    wheel_orders: tuple[int, ...] = field(
        default=(1, 2),
        metadata={
            "unit": "1 a turn",
            "reason": "how often a wheel rubs: once, where it is not round; twice if bent",
        },
    )
    unit_of_time: float = field(
        default=10.0,
        metadata={
            "unit": "s",
            "reason": "that stands for a turn where periods in time are sought as those of a "
            "wheel are: from 0.2 s on",
        },
    )
    drag_lever: float = field(
        default=0.3,
        metadata={
            "unit": "m",
            "reason": "forwards and sideways, of a point of the robot that drags: a robot's half "
            "length, from where a search goes on",
        },
    )
    fading_times: tuple[float, ...] = field(
        default=(10.0, 30.0),
        metadata={"unit": "s", "reason": "of a friction that fades, from where a search goes on"},
    )
    wall_ways: tuple[float, ...] = field(
        default=(0.15, 0.4, 0.9),
        metadata={
            "unit": "m",
            "reason": "beyond where the platform has been, of a wall whose push grows as it nears",
        },
    )
    line_shares: tuple[float, ...] = field(
        default=(0.2, 0.5, 0.8),
        metadata={
            "unit": "quantile of the places, and share of the reach",
            "reason": "where oblique lines are tried along each direction: both, since the "
            "platform may have been beyond one for a moment only",
        },
    )
    powers: tuple[float, ...] = field(
        default=(1.0, 2.0),
        metadata={"unit": "1", "reason": "of a distance that a force fades with: 1/r and 1/r^2"},
    )
    point_core: float = field(
        default=0.1,
        metadata={"unit": "m", "reason": "within which a force from a point no longer grows"},
    )
    point_margin: float = field(
        default=0.6,
        metadata={"unit": "m", "reason": "beyond where it has been that a magnet may stand"},
    )
    point_spacing: float = field(
        default=0.4,
        metadata={"unit": "m", "reason": "between such places; nearer ones are tried where it was"},
    )
    nearest: float = field(
        default=0.05,
        metadata={"unit": "m", "reason": "to a wall that is not reached: a push stays finite"},
    )
    slowest_share: float = field(
        default=1e-2,
        metadata={
            "unit": "1",
            "reason": "of the largest speed, below which a motion has no direction: what friction "
            "does there is as small as the speed's noise",
        },
    )
    shortest_period: float = field(
        default=0.04,
        metadata={
            "unit": "m",
            "reason": "of a force periodic in place: at 0.4 m/s it swings at 10 Hz, of which the "
            "filter of forces leaves a sixth",
        },
    )
    most_cycles: float = field(
        default=40.0,
        metadata={"unit": "1 a turn", "reason": "of a torque periodic in a wheel's angle"},
    )
    periods: int = field(
        default=6,
        metadata={
            "unit": "1",
            "reason": "of the strongest periods, how many are looked at closely",
        },
    )

    smoothing: tuple[float, float, float, float] = field(
        default=(0.01, 0.02, 0.03, 0.1),
        metadata={
            "unit": "m/s, rad/s, rad/s, rad/s",
            "reason": "width of the step of a dry friction over a speed of the platform, its yaw "
            "rate, a wheel's and a roller's rate: as in the catalogue, beyond the speeds' noise",
        },
    )
    switch_time: float = field(
        default=0.1,
        metadata={
            "unit": "s",
            "reason": "width of a step in time: a sampled jump moves only by whole samples",
        },
    )
    edge_width: float = field(
        default=0.02,
        metadata={"unit": "m", "reason": "of a patch's border: less than a contact patch is long"},
    )
    most_load_share: float = field(
        default=0.4,
        metadata={
            "unit": "share of a usual torque",
            "reason": "that a loss may take which grows with the torque: with more of it a motion "
            "might have no torque, or two",
        },
    )
    most_lost_share: float = field(
        default=0.9,
        metadata={
            "unit": "share of a torque",
            "reason": "that a drive may lose in proportion to it: with all of it lost no torque "
            "would drive the motion",
        },
    )
    least_cycles: float = field(
        default=0.3,
        metadata={"unit": "1 a turn", "reason": "slower ones are a drift of the angle"},
    )
    max_factor_terms: int = field(
        default=1,
        metadata={"unit": "1", "reason": "a law of more factors is no factor of a product itself"},
    )

    max_logs_apart: int = field(
        default=8,
        metadata={
            "unit": "logs",
            "reason": "that have sines of their own in a search for what swings in time: a bound "
            "on memory, which grows with the cube. Of more, those on one clock show it",
        },
    )

    # Evidence
    node_step: float = field(
        default=0.02,
        metadata={
            "unit": "s",
            "reason": "between the samples at which laws are evaluated, at most: a fifth of the "
            "filter's time constant. Rows of friction differ by 0.1 % from those of all samples",
        },
    )
    max_samples_at_once: int = field(
        default=20_000,
        metadata={
            "unit": "samples",
            "reason": "at which a law is evaluated at once: six minutes at that step. Of four "
            "columns what is made on the way takes 10 MB; of an hour at once it took 200 MB",
        },
    )
    row_rate: float = field(
        default=25.0,
        metadata={
            "unit": "1/s",
            "reason": "of the rows on which laws are compared: the filter leaves little above it",
        },
    )
    min_duration: float = field(
        default=60.0,
        metadata={
            "unit": "s",
            "reason": "shorter logs leave too few stretches to search some and confirm on others",
        },
    )
    block_time: float = field(
        default=1.0,
        metadata={
            "unit": "s",
            "reason": "10/a_f: residuals this far apart are independent: the block of the "
            "bootstrap. A patch of floor is met for a second at a time",
        },
    )
    stretch_blocks: int = field(
        default=6,
        metadata={
            "unit": "blocks",
            "reason": "held out together: stretches of 6 s, as where it is asked whether anything "
            "can be predicted",
        },
    )
    episode_blocks: int = field(
        default=1,
        metadata={
            "unit": "blocks",
            "reason": "held out together where what is left lives in a few moments: a spot of the "
            "floor that is met once in a minute would be seen, or not seen, as a whole",
        },
    )
    axis_min_duration: float = field(
        default=15.0,
        metadata={
            "unit": "s",
            "reason": "of one axis, whose motions are shorter: a positioning stage is there and "
            "back in two seconds",
        },
    )
    axis_block_time: float = field(
        default=0.25,
        metadata={
            "unit": "s",
            "reason": "of one axis, whose forces are filtered ten times as fast: ten of the "
            "filter's time constants and more",
        },
    )
    axis_periods: int = field(
        default=22,
        metadata={"unit": "1", "reason": "of a friction along the travel, as the catalogue's"},
    )
    spot_shares: tuple[float, ...] = field(
        default=(0.05, 0.15),
        metadata={"unit": "share of the travel", "reason": "widths of a tight spot of an axis"},
    )
    folds: int = field(
        default=4,
        metadata={"unit": "1", "reason": "of the stretches that the search sees"},
    )
    unseen_share: float = field(
        default=0.4,
        metadata={
            "unit": "share of the stretches",
            "reason": "that the search never sees, for the confirmation",
        },
    )
    bootstrap_draws: int = field(
        default=999,
        metadata={"unit": "1", "reason": "the smallest p-value is then 1/1000"},
    )
    max_p_value: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "of the one law that won, on stretches that the search has not seen; where "
            "nothing else says that anything is missing, family-wise over all that was tried too",
        },
    )
    min_share_of_predictable: float = field(
        default=0.3,
        metadata={
            "unit": "share of the squares that the motion predicts",
            "reason": "a law that takes less of them on unseen stretches is no answer",
        },
    )
    min_share_of_residual: float = field(
        default=0.05,
        metadata={
            "unit": "share of the squares of unseen stretches",
            "reason": "a law that takes less is not material",
        },
    )
    min_share_of_noise: float = field(
        default=0.15,
        metadata={
            "unit": "share of the squares of unseen stretches",
            "reason": "that a periodic law must take where nothing else says that anything is "
            "missing",
        },
    )
    max_rest_share: float = field(
        default=0.5,
        metadata={
            "unit": "share of the squares that accepted effects leave",
            "reason": "a law without them that leaves less is better than they are, and no law is "
            "sought beside them",
        },
    )
    length_penalty: float = field(
        default=0.02,
        metadata={
            "unit": "share of the held-out squares for each constant or factor",
            "reason": "a longer law must be better by that; the simpler of what ties is taken",
        },
    )
    products_below: float = field(
        default=0.9,
        metadata={
            "unit": "share of the squares",
            "reason": "products of two are tried only where single laws take less. The share that "
            "is predicted is no measure: of a drag that begins at a time trees predicted 0.65, a "
            "law of one variable took 0.71, and the true one 0.99",
        },
    )
    factors: int = field(
        default=3,
        metadata={"unit": "1", "reason": "single laws that are tried as a factor of a product"},
    )

    # Refinement of shape constants
    refined: int = field(
        default=10,
        metadata={"unit": "1", "reason": "laws whose constants are sought: a bound on time"},
    )
    refinement_steps: int = field(
        default=40,
        metadata={
            "unit": "evaluations for each constant",
            "reason": "of a simplex search: a bound on time",
        },
    )
    map_blocks: int = field(
        default=20,
        metadata={
            "unit": "1 a log",
            "reason": "blocks of each log, held out in turn, that judge a map of the residual: it "
            "is refused where it has not been, so a whole log, alone in a part of the range, says "
            "nothing against it",
        },
    )
    map_points: int = field(
        default=9,
        metadata={"unit": "1", "reason": "places in the table of a map's curve: a screen"},
    )
    compared: int = field(
        default=8,
        metadata={
            "unit": "1",
            "reason": "leading laws, of which those alike are a set",
        },
    )
    alike_deviations: float = field(
        default=1.64,
        metadata={
            "unit": "1",
            "reason": "of the difference of what two laws leave, block by block: one-sided, 5 %",
        },
    )
    shown: int = field(
        default=8,
        metadata={"unit": "1", "reason": "laws in the list of length against error"},
    )

    min_shown_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the largest of its unit",
            "reason": "of a law's numbers, one a wheel: smaller ones are not worth a word",
        },
    )
    shown_alternatives: int = field(
        default=2,
        metadata={"unit": "1", "reason": "laws alike in a sentence: with the law a set of three"},
    )

    def of_an_axis(self) -> ProposalSettings:
        """Those of one axis."""
        own = {"min_duration": self.axis_min_duration, "block_time": self.axis_block_time}
        return replace(self, **own)

    def __post_init__(self) -> None:
        check_settings(self, "proposal settings", positive=True)
