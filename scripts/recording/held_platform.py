"""Platforms that hardly move under the torques of their drives: said, with what holds them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from controllers.recording import MIN_SHARE_OF_MOTION, holding_effects
from identification.logs.findings import names_of, percent
from youbot_env.motions.base import Motion
from youbot_scripts.recording.named_plants import Driven


def held_platform(
    driven: Driven, motions: Sequence[Motion], moved: Mapping[str, float], rate: float
) -> Iterator[str]:
    """A sentence where the plant hardly moved, with the effects that hold it.

    Parameters
    ----------
    moved : by a motion's name, the speeds over those that it asks for, root mean square
    rate : of the logs [Hz]
    """
    held = [motion for motion in motions if moved[motion.name] < MIN_SHARE_OF_MOTION]
    if not held:
        return
    names = tuple(driven.model.effects)
    if driven.contact is None:
        names = holding_effects(driven.model, held[0], rate=rate) or names
    cause = "no torque within the limit drives it"
    if names:
        takes = "takes" if len(names) == 1 else "take"
        cause = f"{' and '.join(names)} {takes} the torque, or holds against it; make it smaller"
    most = max(moved[motion.name] for motion in held)
    yield (
        f"{names_of([motion.name for motion in held])}: the platform hardly moves (at most "
        f"{percent(most)} of the speeds that are asked for): {cause}"
    )
