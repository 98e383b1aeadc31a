"""All numbers that somebody chose for a diagnosis, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from identification.fitting.settings import FitSettings
from identification.proposal.settings import ProposalSettings
from identification.residual_map.settings import RegimeSettings, ResidualMapSettings
from youbot_env.errors import Settings, check_settings


@dataclass(frozen=True)
class DiagnosisSettings(Settings):
    """What a verdict depends on.

    Each field's ``metadata`` holds its unit and the reason for its default.

    Raises
    ------
    InputError
        If a number is not finite and positive.
    """

    # Settings of what the diagnosis is made of
    fit: FitSettings = field(default_factory=FitSettings)
    residual_map: ResidualMapSettings = field(default_factory=ResidualMapSettings)
    regime: RegimeSettings = field(default_factory=RegimeSettings)
    proposal: ProposalSettings = field(default_factory=ProposalSettings)

    # Verdict
    min_explained_share: float = field(
        default=0.4,
        metadata={
            "unit": "share of what was predictable beyond the base model",
            "reason": "where all effects together take less and the rest is unknown, they imitate "
            "it: of a carpet's nap, which no effect is, an uneven friction takes 26 %",
        },
    )
    max_imitators_share: float = field(
        default=0.9,
        metadata={
            "unit": "share of what was predictable beyond the base model",
            "reason": "effects that together take less, where a rule says that all that is missing "
            "lives in a part of the motion, imitate it: of a friction of one wheel in one "
            "direction slope and uneven friction took 68 %, slope and gain error 76 %",
        },
    )
    max_small_rest: float = field(
        default=0.005,
        metadata={
            "unit": "share of what was predictable beyond the base model",
            "reason": "a rest this small beside the effects found is their own inexactness: a "
            "wheel angle that is integrated from noisy speeds leaves 0.1 % of a torque ripple",
        },
    )
    max_small_rest_share: float = field(
        default=0.2,
        metadata={
            "unit": "predictable share of what is left",
            "reason": "such a rest must also be small beside the noise",
        },
    )
    min_changed_error_ratio: float = field(
        default=1.5,
        metadata={
            "unit": "given over refitted force error",
            "reason": "from here on the model's own parameters are said to have changed",
        },
    )

    # Acceptance of an effect
    max_search_time: float = field(
        default=60.0,
        metadata={
            "unit": "s of all cores together",
            "reason": "no ranking is begun after it; a diagnosis then ends within a minute on two "
            "cores. Logs of 260 s at 100 Hz with two effects take 15 s",
        },
    )
    max_samples: int = field(
        default=200_000,
        metadata={
            "unit": "samples of all logs together",
            "reason": "of more, faster logs are averaged down: six minutes at 1 kHz took 80 s and "
            "1.6 GB, and tell no effect apart that 100 Hz do not",
        },
    )
    min_sample_rate: float = field(
        default=100.0,
        metadata={
            "unit": "Hz",
            "reason": "no log is averaged below it: a ripple of 120 rad/s still lies well below",
        },
    )
    max_effects: int = field(
        default=6,
        metadata={
            "unit": "1",
            "reason": "accepted at most",
        },
    )
    max_p_value: float = field(
        default=0.01,
        metadata={
            "unit": "1",
            "reason": "family-wise, over all candidates",
        },
    )
    max_p_value_of_noise: float = field(
        default=0.2,
        metadata={
            "unit": "1",
            "reason": "up to here the p-value of what acts on torques is computed once more, "
            "without what noise that is in column and residual makes of it: a bound on time",
        },
    )
    min_share_of_residual: float = field(
        default=0.05,
        metadata={
            "unit": "share of the held-out squares",
            "reason": "an effect that takes less of them away is not material",
        },
    )
    min_share_of_predictable: float = field(
        default=0.08,
        metadata={
            "unit": "share of the squares that the motion predicts",
            "reason": "an effect that takes less of them away is a small part of something else. "
            "Of a real positioning axis three true effects take 61, 11 and 34 %, one after another",
        },
    )
    min_share_of_coloured_noise: float = field(
        default=0.2,
        metadata={
            "unit": "share of the squares beyond white noise, where nothing is predictable",
            "reason": "a delay took 10 % of the squares of a floor's joints, which act as noise 9 "
            "times the white one; a quarter of each effect beside white noise takes 11 % and more",
        },
    )
    max_velocity_error_ratio: float = field(
        default=1.02,
        metadata={
            "unit": "velocity error with an effect over that without it, held out",
            "reason": "an effect that makes the free run worse is not what is missing; of 36 "
            "planted effects, a quarter of catalogue size among them, none came above 0.996. The "
            "rest is for one of two effects that only work together: it may come first",
        },
    )
    max_noisy_velocity_error_ratio: float = field(
        default=1.5,
        metadata={
            "unit": "velocity error with an effect over that without it, held out",
            "reason": "up to here an effect may make the free run worse if noise alone does so, "
            "were the effect true: 1.06 of a true cogging along an axis. Counted speeds made one "
            "of 1.7 that was not there",
        },
    )
    max_free_run_noise: float = field(
        default=0.3,
        metadata={
            "unit": "velocity error that noise alone makes of a free run",
            "reason": "where it is larger the free run says nothing against an effect: 0.64 of the "
            "true model of an arm, which falls as a pendulum does; 0.004 to 0.1 of platforms",
        },
    )
    max_lost_share: float = field(
        default=0.2,
        metadata={
            "unit": "share of what an effect takes away in the other logs",
            "reason": "a real effect helps in each log that is held out; where it does harm in "
            "some, by more than this, it imitates something else",
        },
    )
    max_quiet_rise: float = field(
        default=1.5,
        metadata={
            "unit": "times the squares outside of episodes",
            "reason": "that an effect may leave there: a slope that met a gust halfway left 6 "
            "times as much where no wind blew; a true effect leaves less",
        },
    )
    min_share_on_grip: float = field(
        default=0.8,
        metadata={
            "unit": "share that an effect takes where no wheel slips, over that of all rows",
            "reason": "on rollers with a friction of 0.08, a true dry friction took 83 % in place "
            "of 65 %; a roller angle, resonance and roller friction that nobody planted took 8, 3 "
            "and 6 % in place of 31, 17 and 10 %",
        },
    )
    min_burst_square_ratio: float = field(
        default=2.0,
        metadata={
            "unit": "mean square of the residual in a burst of slip, over that elsewhere",
            "reason": "from which on the forces fail too: half of the bursts have more than 2.5 on "
            "contact simulators with a friction of 0.15 to 0.3; more than 0.7 to 1.0 where "
            "rollers ripple",
        },
    )
    min_bursts: int = field(
        default=3,
        metadata={"unit": "1", "reason": "one may be a bump, two a chance"},
    )
    min_burst_rate: float = field(
        default=1 / 60,
        metadata={
            "unit": "1/s",
            "reason": "of bursts in which forces fail: 2 to 3 a minute with a friction of 0.25, "
            "1.1 at 0.3; at most 0.5 at 0.8 and 1",
        },
    )
    paired_candidates: int = field(
        default=2,
        metadata={
            "unit": "1",
            "reason": "candidates that are tried together with each other one where none is "
            "enough alone: a bound on time",
        },
    )
    min_promised_share_of_pair: float = field(
        default=0.75,
        metadata={
            "unit": "share of what two effects must take away",
            "reason": "what the first one's fall and a linear step to the second promise, from "
            "which on the second is tried: six pairs on three logs took 0.87 to 1.11 of it, and "
            "with all 24 seconds tried a diagnosis took twice as long",
        },
    )
    min_error_over_floor: float = field(
        default=0.97,
        metadata={
            "unit": "force error of the fit over what white noise leaves",
            "reason": "below it the level of white noise is in doubt, and the search goes on",
        },
    )
    max_final_error_over_floor: float = field(
        default=1.02,
        metadata={
            "unit": "force error of the fit over what white noise leaves",
            "reason": "up to here the search ends, if nothing is predictable: a fall of the "
            "squares by 5 % would end below white noise",
        },
    )
    max_revision_rounds: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "times that all accepted effects are tried against their rivals again, a "
            "bound on time",
        },
    )

    # Candidates
    row_rate: float = field(
        default=50.0,
        metadata={
            "unit": "1/s",
            "reason": "for the choice of effects: torque ripple lives above what a fit needs",
        },
    )
    peak_quantile: float = field(
        default=0.999,
        metadata={
            "unit": "quantile of the absolute torques of all logs",
            "reason": "what counts as the largest torque: single outliers are beyond it. Limits of "
            "the torque are sought at shares of it, from 0.1 to 0.85",
        },
    )
    max_instants: int = field(
        default=72,
        metadata={
            "unit": "1",
            "reason": "of a log, at which an effect may set in, that are tried before the best is "
            "sought between: every 5 s of six minutes, every 50 s of an hour",
        },
    )
    grid_halvings: int = field(
        default=3,
        metadata={
            "unit": "1",
            "reason": "of a grid's step around its best value: an eighth of a step",
        },
    )
    max_refined_share: float = field(
        default=0.98,
        metadata={
            "unit": "share of the structure's held-out squares",
            "reason": "a candidate that leaves more is not worth a search between the values of "
            "its grid",
        },
    )
    min_imitated_share: float = field(
        default=0.995,
        metadata={
            "unit": "share of a column's squares",
            "reason": "explained by another effect's columns, from which on that effect contains "
            "it",
        },
    )
    min_seen_share: float = field(
        default=1e-10,
        metadata={
            "unit": "share of the largest eigenvalue",
            "reason": "rounding of normal equations: directions with less are not seen",
        },
    )

    # Effects in some logs only
    max_logs_for_any_choice: int = field(
        default=4,
        metadata={
            "unit": "1",
            "reason": "up to here an effect is tried in each set of logs; of more logs in each "
            "one, in all since one and in all before one: a bound on time and on chance",
        },
    )
    min_choice_gain: float = field(
        default=0.01,
        metadata={
            "unit": "share of the structure's squares",
            "reason": "by which an effect must be better in more logs to be named in more: logs "
            "that hardly show it make no difference",
        },
    )

    min_share_of_first_instance: float = field(
        default=0.01,
        metadata={
            "unit": "share of the squares that the effect takes already",
            "reason": "to be accepted once more, in some logs, at other values: 17 % of its size "
            "in one log of three. Of a ripple, whose angles drift, a second one took 0.2 %",
        },
    )

    # Joint fits of the candidates in the lead
    max_joint_fits: int = field(
        default=5,
        metadata={
            "unit": "1",
            "reason": "a bound on time",
        },
    )
    min_share_of_needed_fall: float = field(
        default=0.5,
        metadata={
            "unit": "share of the fall that acceptance needs",
            "reason": "where the best candidate falls by less, no joint fit is worth its time",
        },
    )
    min_share_of_best_fall_nonlinear: float = field(
        default=0.2,
        metadata={
            "unit": "share of the best candidate's fall",
            "reason": "in place of min_share_of_best_fall for an effect in whose parameters the "
            "force is not linear: without strength a delay's column is the torque's noisy rate, "
            "and shows less than half of what it can do",
        },
    )
    min_kept_share_of_fall: float = field(
        default=0.5,
        metadata={
            "unit": "share of the fall that held-out steps promise",
            "reason": "where a joint fit keeps less, bounds forbid the rest, and the fall of the "
            "joint fit counts",
        },
    )

    # Which of two candidates
    min_share_of_best_fall: float = field(
        default=0.5,
        metadata={
            "unit": "share of the best candidate's fall",
            "reason": "that a candidate must reach to be fitted jointly, to tie and to be tried "
            "again",
        },
    )
    max_inexact_share_of_drives: float = field(
        default=0.002,
        metadata={
            "unit": "share of the fall in held-out squares",
            "reason": "by which one of lag, delay and resonance may be worse than another and is "
            "told with it: of a delay of 98 ms a resonance explained 0.0004 more, surely; of a lag "
            "and a delay as long the one explains 0.02 more than the other",
        },
    )
    max_tied_deviations: float = field(
        default=2.0,
        metadata={
            "unit": "standard errors",
            "reason": "within which two candidates cannot be told apart",
        },
    )
    min_extension_gain: float = field(
        default=0.05,
        metadata={
            "unit": "share of the simpler effect's squares",
            "reason": "by which its extension must be better to take its place",
        },
    )
    other_widths: tuple[float, ...] = field(
        default=(0.1, 0.3, 0.6, 1.0, 1.7, 3.0, 10.0),
        metadata={
            "unit": "usual width",
            "reason": "at which a dry friction is tried before one that has a breakaway peak, or "
            "one a wheel, takes its place: steps at standstill are as steep as 1e-3 rad/s on a "
            "real robot and as wide as 0.3 where rollers give way",
        },
    )
    finer_widths: tuple[float, ...] = field(
        default=(1.6, 1.3, 1.14, 1.07),
        metadata={
            "unit": "1",
            "reason": "factors around the best of those, one after another: a width that is 7 % "
            "off leaves less than the noise of a log",
        },
    )
    max_noise_gain: float = field(
        default=0.5,
        metadata={
            "unit": "share of the simpler effect's squares",
            "reason": "above it no noise alone can have made the extension better",
        },
    )
    bootstrap_draws: int = field(
        default=999,
        metadata={
            "unit": "1",
            "reason": "the smallest p-value is then 1/1000",
        },
    )
    min_score_share: float = field(
        default=1e-12,
        metadata={
            "unit": "share of the largest eigenvalue",
            "reason": "rounding: directions of a score with less are left out",
        },
    )

    def __post_init__(self) -> None:
        check_settings(self, "diagnosis settings", positive=True)

    @cached_property
    def rows(self) -> FitSettings:
        """Those of the rows on which effects are chosen; made once, for all fields are checked."""
        return replace(self.fit, row_rate=self.row_rate)
