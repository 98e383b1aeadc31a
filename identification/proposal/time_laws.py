"""Laws of time: what pulls or pushes for a while, from a time on, or ever more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from identification.proposal.law import Constant, Law
from identification.proposal.settings import ProposalSettings
from identification.proposal.surroundings import CONFIRM, Surroundings, instants
from youbot_env.physics.effect import BODY, WORLD


def _pushes() -> tuple[Law, ...]:
    """What acts whatever the robot does."""
    pull = (Constant("force_x", "N", size=5.0), Constant("force_y", "N", size=5.0))
    moment = Constant("moment", "N m", size=1.0)
    return (
        Law(
            "pull", WORLD, ("time",), pull, (), "force_x, force_y, 0.0",
            "Force along the world", "f", "f",
            "Something pulls towards one side of the room.", CONFIRM["time"],
        ),
        Law(
            "turning", WORLD, ("time",), (moment,), (), "0.0, 0.0, moment",
            "Moment", "m", "m", "Something turns the robot.", CONFIRM["time"],
        ),
        Law(
            "push_on_board", BODY, ("time",), (*pull, moment), (), "force_x, force_y, moment",
            "Force and moment that turn with the robot", "f", "f",
            "Something pushes the robot towards one of its own sides.", CONFIRM["time"],
        ),
    )  # fmt: skip


def laws_by_time(seen: Surroundings, settings: ProposalSettings) -> Iterator[Law]:
    """Each push for a while, from a time on, and ever more."""
    for push in _pushes():
        yield _for_a_while(push, seen, settings)
        yield _growing(push)
        # Along the world that is one of the products: the catalogue has a constant pull.
        if push.name != "pull":
            yield late(push, seen, settings)


def _parts(law: Law) -> list[str]:
    return [part.strip() for part in law.result.split(",")]


def _scaled(law: Law, size: str) -> str:
    """What a law returns, times a size; zeros stay."""
    return ", ".join(part if part == "0.0" else f"{size} * {part}" for part in _parts(law))


def _for_a_while(law: Law, seen: Surroundings, settings: ProposalSettings) -> Law:
    middle = Constant("middle", "s", 0.0, seen.duration, 10.0, instants(seen, settings))
    width = Constant("width", "s", 1.0, seen.duration, 5.0, (3.0, 10.0))
    return replace(
        law,
        name=f"{law.name}_for_a_while",
        constants=(*law.constants, middle, width),
        lines=(f"share = xp.exp(-((({law.point}.time - middle) / width) ** 2))",),
        result=_scaled(law, "share"),
        meaning=f"{law.meaning}, coming and going in each log",
        formula=f"{law.formula} exp(-((t - t_m)/b)^2)",
        latex=rf"{law.latex} e^{{-((t - t_m)/b)^2}}",
        recognise=f"{law.recognise.rstrip('.')} for a while.",
        terms=2,
    )


def late(law: Law, seen: Surroundings, settings: ProposalSettings) -> Law:
    """A law from a time on."""
    instant = Constant("instant", "s", 0.0, seen.duration, 10.0, instants(seen, settings))
    acts = f"acts = 0.5 + 0.5 * xp.tanh(({law.point}.time - instant) / {settings.switch_time:g})"
    return replace(
        law,
        name=f"late_{law.name}",
        variables=tuple(dict.fromkeys((*law.variables, "time"))),
        constants=(*law.constants, instant),
        lines=(acts, *law.lines),
        result=_scaled(law, "acts"),
        meaning=f"{law.meaning} from a time on",
        formula=f"{law.formula} (t > t_0)",
        latex=rf"{law.latex}\,[t > t_0]",
        confirm=CONFIRM["time"],
        terms=law.terms + 1,
    )


def _growing(law: Law) -> Law:
    """A force that grows steadily from the start of each log, from one that is there already."""
    growth = {
        c.name: replace(c, name=f"{c.name}_growth", unit=f"{c.unit}/s", size=c.size / 60.0)
        for c in law.constants
    }
    grown = (
        part if part == "0.0" else f"{part} + {growth[part].name} * {law.point}.time"
        for part in _parts(law)
    )
    return replace(
        law,
        name=f"{law.name}_that_grows",
        constants=(*law.constants, *growth.values()),
        result=", ".join(grown),
        meaning=f"{law.meaning}, growing from the start of each log",
        formula=f"{law.formula} + g t",
        latex=f"{law.latex} + g t",
        recognise=f"{law.recognise.rstrip('.')}, more from minute to minute.",
        terms=2,
    )
