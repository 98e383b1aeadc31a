"""All numbers that somebody chose for the import of foreign files, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class ImportSettings(Settings):
    """What the import of a foreign file reads, guesses and mends.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    # Bounds on what is read
    max_bytes: int = field(
        default=1 << 30,
        metadata={"unit": "bytes", "reason": "a text of that size, uncompressed, is 10 hours"},
    )
    max_messages: int = field(
        default=20_000_000,
        metadata={"unit": "messages", "reason": "of a topic: 5 hours at 1 kHz"},
    )
    max_message_bytes: int = field(
        default=1 << 16,
        metadata={"unit": "bytes", "reason": "pictures and scans are larger, joints are not"},
    )
    max_array: int = field(
        default=64,
        metadata={"unit": "numbers", "reason": "longer lists in a message are no joints"},
    )
    max_fields: int = field(
        default=4096,
        metadata={"unit": "numbers", "reason": "of a message: a state of 100 joints has 400"},
    )
    max_record_bytes: int = field(
        default=1 << 28,
        metadata={"unit": "bytes", "reason": "of a chunk of an MCAP file: usual ones have 1 MB"},
    )

    # Guesses
    max_guesses: int = field(
        default=3,
        metadata={"unit": "units", "reason": "a reader in a trial could not choose among six"},
    )

    # Text files
    header_search: int = field(
        default=60,
        metadata={"unit": "lines", "reason": "a header stands below no more lines of remarks"},
    )
    min_number_share: float = field(
        default=0.9,
        metadata={
            "unit": "share of the filled cells",
            "reason": "a column with fewer numbers is text; the other cells are missing values",
        },
    )

    max_number: float = field(
        default=1e100,
        metadata={
            "unit": "1",
            "reason": "no sensor gives more; larger ones count as missing: their squares overflow",
        },
    )

    # Time
    min_step: float = field(
        default=2e-4,
        metadata={"unit": "s", "reason": "no wheel is logged faster; tells ms from s"},
    )
    max_step: float = field(
        default=0.3,
        metadata={"unit": "s", "reason": "nor as slowly"},
    )
    min_epoch: float = field(
        default=6.3e8,
        metadata={"unit": "s", "reason": "1990 since 1970: a date is later"},
    )
    max_epoch: float = field(
        default=4.2e9,
        metadata={"unit": "s", "reason": "2103: a date is earlier"},
    )
    max_coarse_step: float = field(
        default=2.0,
        metadata={"unit": "s", "reason": "a date is written in whole seconds at the coarsest"},
    )
    min_day: float = field(
        default=25_000.0,
        metadata={"unit": "days", "reason": "since 1900, as spreadsheets count: 1968"},
    )
    max_day: float = field(
        default=80_000.0,
        metadata={"unit": "days", "reason": "since 1900: 2119, later than any log"},
    )
    assumed_rate: float = field(
        default=100.0,
        metadata={"unit": "Hz", "reason": "proposed, to be checked, where a file tells no time"},
    )
    min_regular_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of the steps",
            "reason": "as many regular steps after sorting: rows were exchanged, not runs joined",
        },
    )
    min_distinct_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the messages",
            "reason": "with fewer different stamps a driver does not set them; several messages of "
            "one instant (an arm's joints, each wheel's) share one",
        },
    )
    max_repeated_share: float = field(
        default=0.05,
        metadata={
            "unit": "share of the rows",
            "reason": "with more rows of other data at a time that was there, two runs are joined",
        },
    )
    gap_steps: float = field(
        default=4.0,
        metadata={
            "unit": "usual steps",
            "reason": "a longer pause of a channel is a gap: nothing is interpolated across it",
        },
    )
    min_gap: float = field(
        default=0.05,
        metadata={"unit": "s", "reason": "nor is a shorter pause called one, at any rate"},
    )
    split_gap: float = field(
        default=0.2,
        metadata={"unit": "s", "reason": "the reader of logs bridges no longer one"},
    )

    max_trimmed_share: float = field(
        default=0.1,
        metadata={
            "unit": "share of the rows",
            "reason": "most, at both ends together, that are left out where a channel "
            "has no value: recorders of a run start within seconds; a channel that covers less of "
            "it does not cost the others their rows",
        },
    )

    # Resampling
    min_decimation: float = field(
        default=1.2,
        metadata={
            "unit": "rate of a channel over that of the log",
            "reason": "above it a channel is low-passed before it is resampled",
        },
    )
    cutoff_share: float = field(
        default=0.8,
        metadata={
            "unit": "share of half the log's rate",
            "reason": "of the anti-aliasing low-pass: Butterworth, order 4, without delay",
        },
    )
    filter_order: int = field(
        default=4,
        metadata={"unit": "1", "reason": "run forwards and backwards: 48 dB an octave"},
    )
    outlier_window: int = field(
        default=7,
        metadata={"unit": "samples", "reason": "around a pose whose median it is compared with"},
    )
    outlier_deviations: float = field(
        default=8.0,
        metadata={
            "unit": "standard deviations",
            "reason": "of the usual distance from that median; a pose beyond is an outlier",
        },
    )

    # Guesses
    max_speed: float = field(
        default=50.0,
        metadata={"unit": "rad/s", "reason": "as the reader of logs: no wheel turns faster"},
    )
    usual_peak: float = field(
        default=12.0,
        metadata={"unit": "rad/s", "reason": "peak of wheels on a usual drive, to rank units by"},
    )
    least_peak: float = field(
        default=0.5,
        metadata={"unit": "rad/s", "reason": "a unit that makes less of a whole drive is none"},
    )
    max_effort: float = field(
        default=100.0,
        metadata={"unit": "N m", "reason": "as the reader of logs: no wheel is driven harder"},
    )
    zero_effort: float = field(
        default=1e-6,
        metadata={"unit": "N m", "reason": "efforts that never exceed it were not measured"},
    )
    max_slip: float = field(
        default=0.1,
        metadata={
            "unit": "share of the speeds",
            "reason": "as the reader of logs: what the no-slip identity may leave",
        },
    )
    max_remaining_slip: float = field(
        default=0.3,
        metadata={"unit": "1", "reason": "another order or sign must leave no more of it"},
    )
    max_unit_error: float = field(
        default=0.05,
        metadata={"unit": "1", "reason": "of a ratio of positions and speeds that shows a unit"},
    )
    driving_power: float = field(
        default=0.3,
        metadata={"unit": "net over gross power", "reason": "beyond it a sign is certain"},
    )
    max_yaw: float = field(
        default=13.0,
        metadata={"unit": "rad", "reason": "two turns: a yaw beyond that wraps is in degrees"},
    )
    max_place: float = field(
        default=60.0,
        metadata={"unit": "m", "reason": "a pose that goes farther within a run is in mm"},
    )
    max_yaw_rate: float = field(
        default=12.0,
        metadata={"unit": "rad/s", "reason": "a platform turns no faster: degrees a second"},
    )

    # Delay between channels
    max_delay: float = field(
        default=0.3,
        metadata={"unit": "s", "reason": "of one channel behind another that is looked for"},
    )
    delay_rate: float = field(
        default=100.0,
        metadata={"unit": "Hz", "reason": "at which channels are compared, whatever their own"},
    )
    delay_cutoff: float = field(
        default=4.0,
        metadata={"unit": "Hz", "reason": "motion of a platform lies below, noise above"},
    )
    delay_blocks: int = field(
        default=20,
        metadata={"unit": "1", "reason": "stretches, each left out in turn, for the interval"},
    )
    min_delay_correlation: float = field(
        default=0.7,
        metadata={"unit": "1", "reason": "with less the two channels do not show one motion"},
    )
    min_delay: float = field(
        default=2e-3,
        metadata={"unit": "s", "reason": "less is not told: half a sample at 250 Hz"},
    )
    interval_deviations: float = field(
        default=1.96,
        metadata={"unit": "standard deviations", "reason": "95 % of a Gaussian"},
    )

    def __post_init__(self) -> None:
        check_settings(self, positive=True)
