"""All numbers that somebody chose for fleets, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class FleetSettings(Settings):
    """What the screening of a robot and the statistics of a fleet depend on.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    # Each robot
    max_screened_share: float = field(
        default=0.0,
        metadata={
            "unit": "share of the residual's squares",
            "reason": "that the motion may predict of a robot that is not diagnosed in full; of "
            "40 robots to which nothing was added it was -0.08 to -0.03, of 40 effects at a "
            "quarter of their size under twice the noise one alone stayed below 0 that a "
            "diagnosis names",
        },
    )
    max_screened_mean_over_median: float = field(
        default=1.25,
        metadata={
            "unit": "1",
            "reason": "of the residual's squares in blocks of time: 1.01 to 1.07 on the same 40 "
            "robots; 2.5 where torques were clipped, which the motion did not predict",
        },
    )
    bootstrap_draws: int = field(
        default=19_999,
        metadata={
            "unit": "1",
            "reason": "the smallest p-value is then 1/20000, so that one faulty robot among 200 "
            "can pass at a false discovery rate of 1 %; costs 0.4 s a robot more than 999",
        },
    )

    # The fleet
    false_discovery_rate: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "of a hundred robots that are sent to the workshop one may be sound",
        },
    )
    max_robust_deviations: float = field(
        default=3.5,
        metadata={
            "unit": "robust standard deviations",
            "reason": "from the fleet's median; Iglewicz and Hoaglin (How to Detect and Handle "
            "Outliers, 1993)",
        },
    )
    min_robots_of_spread: int = field(
        default=8,
        metadata={
            "unit": "robots",
            "reason": "fewer say too little of a fleet's spread to call one of them an outlier: "
            "the median deviation of 7 has an error of about 40 %",
        },
    )

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_settings(self)
