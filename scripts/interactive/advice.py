"""What the workbench says of the active model, and what to do next: words alone, no page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from youbot_scripts.interactive.project import Project, Step
from youbot_scripts.shared.tables import percent

ABOUT_MODELS = ("identify", "compare", "diagnose", "add")
"""Kinds of steps that say how well a model fits."""


@dataclass(frozen=True)
class Advice:
    """What to do next.

    Attributes
    ----------
    text : a sentence
    label : of the button that does it; "" where no button of the page does
    do, which : what the button does: a kind of step and, of ``add``, the effect
    """

    text: str
    label: str = ""
    do: str = ""
    which: str = ""


def sentences(project: Project) -> list[str]:
    """What the last command about the active model has found; none before there is one."""
    step = project.last(*ABOUT_MODELS)
    found = project.result(step)
    if step is None or found is None:
        return []
    if step.kind == "diagnose":
        return [f"{found['headline']}.", *(_sentence(line) for line in found["words"]), HELD_OUT]
    if step.kind == "add":
        return _of_addition(found)
    if step.kind == "compare":
        return _of_comparison(project, step, found)
    return _of_fit(found)


HELD_OUT = (
    "These errors are held out: each log, or each part of one, is judged by a fit to the others. "
    "Those of Identify are on the very logs that it was fitted to, and its noise is a rough "
    "estimate where something is missing."
)


def _of_addition(found: Mapping[str, Any]) -> list[str]:
    before, after = (percent(found[name]["force_error"]) for name in ("before", "after"))
    noise = percent(found["noise_floor"]["force_error"])
    worth = "worth it" if found["worthwhile"] else "not worth it"
    told = f"Force error, held out, {before} → {after} (noise alone {noise}): {worth}."
    reasons = [f"Not worth it: {reason}." for reason in found["reasons"]]
    lacks = "The model still lacks something." if found.get("misfit") else "It fits."
    return [told, _sentence(found["words"]), *reasons, lacks]


def _sentence(text: str) -> str:
    """With a capital letter and a full stop: commands print it as an item of a list."""
    return text[:1].upper() + text[1:].rstrip(".") + "." if text else ""


def _of_fit(found: Mapping[str, Any]) -> list[str]:
    errors = found["errors"]
    error, noise = (percent(item["force_error"]) for item in (errors, errors["noise_floor"]))
    line = f"Force error {error} on the logs that the model was fitted to; noise alone {noise}"
    if found.get("misfit"):
        doubt = ", which is known only roughly while something is missing"
        return [f"{line}{doubt}.", "The model lacks something."]
    return [f"{line}.", "It fits."]


def _of_comparison(project: Project, step: Step, found: Mapping[str, Any]) -> list[str]:
    error = percent(found["total"]["force_error"])
    noise = percent(found["noise_floor"]["force_error"])
    other = project.result(project.comparison(step.beside, step.logs)) if step.beside else None
    before = percent(other["total"]["force_error"]) + " → " if other else ""
    first = f"Force error {before}{error} {_on(found)}; noise alone {noise}."
    return [first, "The model lacks something." if found.get("misfit") else "It fits."]


def _on(found: Mapping[str, Any]) -> str:
    """Whether errors of a comparison are on logs that the model's fit has seen."""
    unseen = [name for name, item in found["logs"].items() if not item["seen_in_fit"]]
    if not unseen:
        return "on the logs that the model was fitted to"
    if len(unseen) == len(found["logs"]):
        return "on logs that its fit has not seen"
    return f"on {', '.join(unseen)}, which its fit has not seen"


# --- next ------------------------------------------------------------------------------------


def advice(project: Project) -> list[Advice]:
    """What to press next, best first."""
    step = project.last(*ABOUT_MODELS)
    found = project.result(step)
    if step is None or found is None:
        return [_first(project)]
    if step.kind == "diagnose":
        return _after_diagnosis(found)
    if step.kind == "add":
        return _after_addition(project, found)
    left = named_left(project)
    if found.get("misfit") and left:
        return [_add(left[0], f"Next: add {words(left[0])}, which the diagnosis named.")]
    if found.get("misfit"):
        return [Advice("Next: ask what is missing.", "Diagnose", "diagnose")]
    return [_onwards(project)]


def _first(project: Project) -> Advice:
    if not project.chosen:
        return Advice("Choose logs under Logs, or drop them there.")
    checked = project.result(project.last("doctor"))
    if checked is None:
        keep = " Keep one log back, to compare the model on it later." if _all_used(project) else ""
        return Advice(f"Next: check the logs, then identify.{keep}", "Check the logs", "doctor")
    unusable = [name for name, report in checked["logs"].items() if not report["usable"]]
    if unusable:
        return Advice(f"{', '.join(unusable)} cannot be used: see the checks, or leave it out.")
    if project.maker(project.model) is None and project.model != "paper":
        return Advice("The logs can be used. Next: compare the model with them.", *_COMPARE)
    return Advice("The logs can be used. Next: identify.", "Identify", "identify")


_COMPARE = ("Compare", "compare")


def _all_used(project: Project) -> bool:
    return len(project.logs) > 1 and set(project.logs) <= set(project.chosen)


def words(effect: str) -> str:
    """An effect's name as people write it."""
    return effect.replace("_", " ")


def _add(effect: str, text: str) -> Advice:
    return Advice(text, f"Add {words(effect)}", "add", effect)


def _after_diagnosis(found: Mapping[str, Any]) -> list[Advice]:
    if found["missing"]:
        first, *others = found["missing"]
        then = f", then {' and '.join(words(name) for name in others)}" if others else ""
        return [_add(first, f"Next: add {words(first)}{then}, and watch the error fall.")]
    if found["verdict"] == "adequate":
        return [Advice("Next: drive controllers on the model, or download it.", "Drive", "drive")]
    return []


def _after_addition(project: Project, found: Mapping[str, Any]) -> list[Advice]:
    if not found["worthwhile"]:
        return [Advice("Undo takes it away again.", "Undo", "undo")]
    left = named_left(project)
    if left:
        return [_add(left[0], f"Next: add {words(left[0])}, which the diagnosis named as well.")]
    if found.get("misfit"):
        return [Advice("Next: diagnose again.", "Diagnose again", "diagnose")]
    return [_onwards(project)]


def _onwards(project: Project) -> Advice:
    """After a model that fits."""
    unseen = "a log that the fit has not seen"
    get = f"choose {unseen} and compare"
    if _all_used(project):
        get = f"compare it on {unseen} (all here are chosen: drop another one)"
    return Advice(f"Next: {get}, or drive controllers on the model.", "Drive", "drive")


def named_left(project: Project) -> list[str]:
    """Effects that the diagnosis on the way to the active model named, and that it still lacks.

    None where something else was added since: what was named then may be explained by it now.
    """
    step, added = diagnosis_on_the_way(project)
    found = project.result(step)
    if found is None or not set(added) <= set(found["missing"]):
        return []
    return [name for name in found["missing"] if name not in added]


def diagnosis_on_the_way(project: Project) -> tuple[Step | None, list[str]]:
    """The last diagnosis of the active model, or of one before it that it continues.

    Also the effects that were added since. An identified model continues another one without
    effects: a diagnosis fits the base model again, as Identify does.
    """
    added: list[str] = []
    for name, before in zip(project.versions[::-1], [*project.versions[-2::-1], ""], strict=True):
        step, maker = project.last_of(name, "diagnose"), project.maker(name)
        if step is not None or maker is None:
            return step, added
        if maker.effect:
            added.append(maker.effect)
        elif not _is_base(project, before):
            break
    return None, added


def _is_base(project: Project, model: str) -> bool:
    """Whether a model is known to hold no effects."""
    maker = project.maker(model)
    return model == "paper" or (maker is not None and maker.kind == "identify")
