"""The chapters of the demonstration, from logs to a controller that is built on their model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from youbot_scripts.demonstration.files import CARPET, Demonstration
from youbot_scripts.shared.tables import Column, Table, columns, number, show, text, with_std

CONTROLLERS = ("kinematic", "kinematic_tuned", "computed_torque", "ppo")
"""Compared in the last chapter; they need no extra."""

LAB = (
    "floor_tilt:tilt_x=-0.018,tilt_y=-0.004",
    "torque_offset:offset_fl=0.06,offset_fr=-0.05,offset_bl=0.04,offset_br=-0.03",
)
"""Hidden in the logs that look like a real robot's. Offsets of the front wheels beside equal and
opposite ones of the back wheels exert no force, so these hold nothing of that kind."""


def check(demo: Demonstration) -> None:
    """Check the logs: faults, and which parameters they show."""
    demo.command("doctor", demo.calibration, demo.held_out)


def identify(demo: Demonstration) -> None:
    """Fit the seven parameters to the calibration run."""
    demo.say(
        "The paper's motions I, III, II and IV, 35 s each, under the platform's stock wheel-speed "
        "control."
    )
    demo.command("identify", demo.calibration, "-o", demo.model, *demo.plots)
    demo.say(
        "A rank below 7 means that a motion is blind to the sums of x in its row: only together "
        "do the motions tell all parameters apart."
    )


def judge(demo: Demonstration) -> None:
    """The estimates beside the parameters that the logs were simulated with."""
    from youbot_env.model.model_file import load_model

    found, true = load_model(demo.model), load_model("paper")
    rows = []
    for name, estimate in found.parameters.items():
        truth, std = true.parameters[name].value, estimate.std or float("nan")
        off = (estimate.value - truth) / std
        rows.append((name, truth, with_std(estimate.value, std), off, estimate.unit))
    shown = (Column("true", number), "identified ± std", Column("off by (std)", "{:+.1f}".format))
    headers = columns("name", *shown, text("unit"))
    show(demo.out, [Table("Against the truth", headers, tuple(rows))])
    inside = sum(abs(float(row[3])) <= 1.96 for row in rows)
    demo.say(f"{inside} of {len(rows)} true values lie within ± 1.96 std (95 % are expected to).")


def compare(demo: Demonstration) -> None:
    """The model on a multisine that the fit has not seen."""
    demo.say("A velocity multisine of 0.5 to 3 rad/s, kept aside until now.")
    found = demo.result_of("compare", demo.model, demo.held_out, *demo.plots, to="compare.json")
    error, floor = (found[key]["velocity_error"] for key in ("total", "noise_floor"))
    demo.say(
        f"Driven by the measured torques alone for a minute, the model is {100 * error:.2f} % off "
        f"the measured velocities; noise alone makes {100 * floor:.2f} %. "
        + ("Nothing is missing from it." if error < 1.2 * floor else "Something is missing.")
    )


def fail(demo: Demonstration) -> None:
    """The same model on logs in which an effect is hidden."""
    demo.say("The same robot in another room. Nobody has told the model what is different there.")
    demo.command("compare", demo.model, *demo.changed_room)


def diagnose(demo: Demonstration) -> None:
    """Diagnose the hidden effect, and show how the error falls."""
    found = demo.result_of(
        "diagnose", demo.model, *demo.changed_room, "-o", demo.extended_model, to="diagnosis.json"
    )
    first, last = found["steps"][0], found["steps"][-1]
    demo.say(
        f"The held-out velocity error falls from {100 * first['velocity_error']:.1f} % to "
        f"{100 * last['velocity_error']:.1f} %, where noise alone would leave "
        f"{100 * found['noise_floor']['velocity_error']:.1f} %."
    )


def second_room(demo: Demonstration) -> None:
    """Record logs like those of a real robot, with two things hidden, and diagnose them."""
    demo.say(
        "Real torques are not so clean. The same robot, its noise twice as large, lasting 50 ms, "
        "on a slope, with channels that are off by a few hundredths of a newton metre:"
    )
    slope, offsets = LAB
    demo.command(
        *("record", demo.lab, "--motions", "calibration,multisine_a", "--rate", "50"),
        *("--torque-noise", "0.06", "--noise-correlation", "0.05", "--seed", "5"),
        *("--effect", slope, "--effect", offsets, "--format", "csv.gz"),
    )
    found = demo.result_of(
        "diagnose", demo.model, *demo.lab_logs, "-o", demo.lab_model, to="lab_diagnosis.json"
    )
    demo.say(
        f"Hidden were {slope} and {offsets}; found: {' and '.join(found['missing']) or 'nothing'}."
    )


def drive(demo: Demonstration) -> None:
    """Compare controllers in the changed room: with the first model and with the extended one."""
    demo.say(
        "Controllers in that other room, each on the model from before the diagnosis and on the "
        "one from after it, along references that they have not seen, from noisy encoders and a "
        "sample late: the stock wheel-speed control, the same tuned on the model, computed torque, "
        "and a policy that was trained where the floor is flat."
    )
    found = demo.result_of(
        "evaluate",
        *(word for effect in demo.hidden_effects() for word in ("--effect", effect)),
        *("--model", f"{demo.model},{demo.extended_model}"),
        *("--controllers", ",".join(CONTROLLERS)),
        *("--bands", "0.5-1,1-2,2-4", "--seeds", "3", "--duration", "10"),
        *("--brief", "--jobs", "1"),  # too short to be worth the start of a second process
        *demo.plots,
        to="evaluation.json",
    )
    before, after = (
        _error(found, "computed_torque", model) for model in (demo.model, demo.extended_model)
    )
    tuned = _error(found, "kinematic_tuned", demo.extended_model)
    demo.say(
        f"Computed torque misses {100 * before:.2f} % of the reference on the model that is blind "
        f"to the slope, and {100 * after:.2f} % on the one that knows it; the tuned kinematic "
        f"control {100 * tuned:.1f} %."
    )


def last_room(demo: Demonstration) -> None:
    """Find the law of what the catalogue has not, add it, and drive on it."""
    demo.say(
        "The same robot on a carpet. What acts there is in no catalogue: diagnose may only say "
        "that it does not know, and propose a law."
    )
    base, better = demo.carpet_models
    found = demo.result_of(
        *("diagnose", demo.model, *demo.carpet_logs, "-o", base, "--proposal", demo.law),
        to="carpet_diagnosis.json",
    )
    law = found["proposal"]
    if law is None:
        demo.say("It proposes none: the story ends here.")
        return
    demo.say("The law is a file of some ten lines; every command takes it as an effect:")
    added = demo.result_of(
        *("add", base, law["name"], *demo.carpet_logs, "--effects", demo.law, "-o", better),
        to="carpet_law_added.json",
    )
    truth = [effect for effect in demo.hidden_effects(CARPET[2]) if effect.startswith(law["name"])]
    if not truth:
        demo.say(f"Hidden was {demo.hidden_effects(CARPET[2])[0]}.")
        return
    driven = demo.result_of(
        *("evaluate", "--effects", demo.law, "--effect", truth[0], "--model", f"{base},{better}"),
        *("--controllers", "computed_torque", "--bands", "1-2", "--seeds", "2"),
        *("--duration", "8", "--brief", "--jobs", "1"),
        to="carpet_evaluation.json",
    )
    before, after = (_error(driven, "computed_torque", model) for model in (base, better))
    errors = (added[key]["velocity_error"] for key in ("before", "after", "noise_floor"))
    fall = [f"{100 * error:.1f} %" for error in errors]
    demo.say(
        f"Hidden was {truth[0]}. The held-out velocity error falls from {fall[0]} to {fall[1]} "
        f"(noise {fall[2]}), and computed torque misses {100 * before:.2f} % of its reference "
        f"without the law, {100 * after:.2f} % with it."
    )


def _error(found: dict[str, Any], controller: str, model: Path) -> float:
    """Mean normalised RMSE over axes, seeds and bands."""
    errors = [
        result["metrics"]["nrmse"]["mean"]
        for result in found["results"]
        if (result["controller"], result["model"]) == (controller, str(model))
    ]
    return sum(errors) / len(errors)


CHAPTERS: dict[str, Callable[[Demonstration], None]] = {
    "Are the logs sound, and what can they show?": check,
    "Identify the model from the calibration run": identify,
    "Is that the truth? (Simulated logs: it is known)": judge,
    "Does the model predict a run that it has not seen?": compare,
    "Does it hold in another room?": fail,
    "What is missing?": diagnose,
    "And on logs like those of a real robot?": second_room,
    "Does a better model drive better?": drive,
    "And where the catalogue ends?": last_room,
}
"""The chapters in their order: title and function."""
