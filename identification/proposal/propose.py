"""Propose the law that a fitted structure lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.fitting.gauge import gauge_basis
from identification.fitting.regression import regression
from identification.fitting.settings import FitSettings
from identification.mechanisms.mechanism import Mechanism
from identification.mechanisms.residual_maps import with_effect_of_its_own
from identification.mechanisms.samples import Samples
from identification.proposal.evidence import Evidence
from identification.proposal.grammar import GRAMMARS, Grammar
from identification.proposal.law import Verdict
from identification.proposal.search import Search
from identification.proposal.settings import ProposalSettings
from youbot_env.physics.effect import Effect

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Left:
    """What a structure leaves: the structure, theta (P,), its fitted parameters' indices (F,), and
    the share of its squares that the motion predicts; 0 where nothing says that it does.

    episodic : whether what is left lives in a few moments
    """

    mechanism: Mechanism[Any]
    theta: Array
    free: Indices
    predictable: float
    episodic: bool = False


def find_law(
    left: Left,
    samples: Sequence[Samples],
    seed: int,
    settings: ProposalSettings,
    fit: FitSettings,
    progress: Callable[[], None] = lambda: None,
) -> Verdict | None:
    """The law that explains best what is left, if it is more than chance; None: no law found.

    Where nothing says that anything is left, only laws that repeat themselves over the floor or a
    wheel's angle are tried: they are too fine for what else looks for structure.
    """
    mechanism = left.mechanism
    if mechanism.kind.name not in GRAMMARS:
        return None
    if len(mechanism.axes) == 1:
        settings = settings.of_an_axis()
    rows = replace(fit, row_rate=settings.row_rate)
    basis = gauge_basis(mechanism, left.free) / mechanism.scale[left.free][:, None]
    of_logs = [regression(mechanism, left.theta, item, left.free, rows) for item in samples]
    if sum(len(row.residual) * row.step for row in of_logs) < settings.min_duration:
        return None
    stretch = settings.episode_blocks if left.episodic else settings.stretch_blocks
    evidence = Evidence(
        *(mechanism, left.theta, samples),
        [row.residual for row in of_logs],
        [row.columns @ basis for row in of_logs],
        [row.step for row in of_logs],
        fit.filter.settling_time_constants,
        *(seed, settings, stretch),
    )
    search = Search(evidence, left.predictable, seed, settings, progress)
    grammar = GRAMMARS[mechanism.kind.name](evidence, samples)
    search.add(grammar.periodic())
    if left.predictable > 0:
        _try_everything(search, grammar, settings)
    else:
        search.refine()
    found = search.verdict()
    if found is None or not holds(found, left.predictable, settings):
        return None
    return search.settled(found)


def _try_everything(search: Search, grammar: Grammar, settings: ProposalSettings) -> None:
    """Single laws, and products of two where single ones leave much.

    Of all that is there, noise included: what the motion is known to predict is less than a law
    can take, since trees do not learn all of it.
    """
    search.add(grammar.single())
    search.refine()
    search.add(grammar.like([item.law_at_best() for item in search.leaders[: settings.refined]]))
    search.refine()
    best = search.leaders
    if best and search.fall(best[0]) >= settings.products_below:
        return
    factors = [item.law_at_best() for item in best[: settings.factors]]
    search.add(grammar.products(factors))
    search.refine()


def holds(found: Verdict, predictable: float, settings: ProposalSettings) -> bool:
    """Whether a law is more than chance, and enough, on what the search has not seen."""
    if found.unseen_p_value > settings.max_p_value:
        return False
    if predictable <= 0:
        # Nothing else speaks for it: what acts at a few moments only is not told from chance.
        material = found.unseen_fall >= settings.min_share_of_noise
        return material and found.p_value <= settings.max_p_value
    least = max(settings.min_share_of_predictable * predictable, settings.min_share_of_residual)
    return found.unseen_fall >= least


def with_law(mechanism: Mechanism[Any], effect: Effect) -> Mechanism[Any]:
    """The same mechanism with an effect more, that its catalogue need not have.

    The catalogue of all is left as it is: a law that was proposed for one robot is no candidate for
    the next.
    """
    more = with_effect_of_its_own(mechanism, effect)
    return more.with_effects((*mechanism.structure.effects, effect.name))
