"""The cases of a record: which commands are run on which logs.

Left out, because their diagnosis takes more than minutes: `wild/drive_dead_zone`,
`field/effort_offset`, `hsm150` (only identified), `field/effort_br_unsigned` (only checked and
identified).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tests.behaviour import bad_input
from tests.behaviour.steps import MODEL, Case, Code, Step, lines, shipped, youbot

SIMULATED = (
    *("nominal_1", "nominal_2", "nominal_3", "wheel_coulomb_friction", "floor_tilt"),
    *("uneven_wheel_friction", "actuator_lag", "torque_ripple", "unknown_carpet_nap"),
    *("wheel_coulomb_friction_and_floor_tilt", "blind_1", "blind_2", "blind_3", "blind_4"),
    *("mujoco_nominal", "mujoco_wheel_frictionloss"),
)

WILD = (
    *("torque_offset", "one_wheel_drags_dry", "asymmetric_coulomb", "cable_twist"),
    *("torque_constant_falls", "wheel_3_percent_larger", "roller_axes_43_degrees"),
    *("lag_and_delay", "floor_differs", "payload_differs", "floor_joints", "coloured_noise"),
    *("quantised", "torque_wanders"),
)

FIELD = (
    *("coulomb_ticks_500", "ticks_500_jitter", "ticks_64", "effort_offset_small"),
    *("wall_clock_rtf_half_pose", "pose_says_radius_5pc", "velocity_lowpass_50ms"),
    *("receive_time_bursts", "effort_order_fl_bl_fr_br", "velocity_in_turns_s"),
    *("stale_effort_20hz", "pushed_by_hand"),
)

QUICK = {
    *("nominal_1", "wheel_coulomb_friction", "wild/lag_and_delay", "field/ticks_64"),
    "field/velocity_in_turns_s",
}
"""Folders of the short record."""

ADDED = {
    "wheel_coulomb_friction": "wheel_coulomb_friction",
    "uneven_wheel_friction": "uneven_wheel_friction",
    "actuator_lag": "actuator_lag",
    "torque_ripple": "torque_ripple",
    "unknown_carpet_nap": "tether",
    "mujoco_wheel_frictionloss": "wheel_coulomb_friction",
    "wild/lag_and_delay": "torque_delay",
    "wild/one_wheel_drags_dry": "uneven_wheel_friction",
    "wild/quantised": "roller_inertia",
    "wild/torque_constant_falls": "torque_gain_error",
}
"""Which effect `add` adds to a folder's model; to the others `floor_tilt`."""


def folder_of_logs(name: str) -> Case:
    """The five commands on a platform's logs, each on what the one before has written."""
    ending = ".csv.gz" if name.startswith(("wild/", "field/")) else ".csv"
    multisine = "multisine" if name.startswith("mujoco") else "multisine_a"
    held_out = "multisine" if name == "mujoco_wheel_frictionloss" else "multisine_b"
    calibration, fitted, held_out = (
        f"data/{name}/{log}{ending}" for log in ("calibration", multisine, held_out)
    )
    both, effect = f"{calibration} {fitted}", ADDED.get(name, "floor_tilt")
    steps = (
        youbot(f"doctor {calibration} {fitted} --json doctor.json", "doctor"),
        youbot(f"identify {calibration} -o model.json --json identify.json", "identify"),
        youbot(f"compare {MODEL} {held_out} --json compare.json", "compare"),
        youbot(f"diagnose {MODEL} {both} -o better.json --json diagnose.json", "diagnose"),
        youbot(f"add {MODEL} {effect} {both} -o added.json --json add.json", "add"),
    )
    return Case(f"data_{name.replace('/', '_')}", steps, name in QUICK, (calibration,))


def other_folders() -> Iterator[Case]:
    log = "data/field/effort_br_unsigned/calibration.csv.gz"
    steps = (youbot(f"doctor {log} --json d.json", "doctor"), youbot(f"identify {log}", "identify"))
    yield Case("data_field_effort_br_unsigned", steps, False, (log,))

    yield Case(
        "data_field_headers",
        (youbot("doctor data/field/headers/*.csv.gz --json doctor.json", "doctor"),),
        True,
        ("data/field/headers",),
    )

    log = "data/hsm150/idf_pos_0.06_1.csv.gz"
    steps = (
        youbot(f"doctor {log} --mechanism axis", "doctor"),
        youbot(f"identify {log} --mechanism axis -o axis.json --json identify.json", "identify"),
        youbot(f"compare axis.json {log} --json compare.json", "compare"),
    )
    yield Case("data_hsm150", steps, False, (log,))

    bag = "data/polimi_mecanum/bag1.bag"
    yield Case("data_polimi", (youbot(f"doctor {bag}"),), False, (bag,))


def axis() -> Case:
    data = "data/emps/DATA_EMPS.mat"
    steps = (
        Step((data, "emps.csv"), "emps_to_log.py", "convert"),
        youbot("doctor emps.csv --mechanism axis --unit m --json doctor.json", "doctor"),
        youbot(
            "identify emps.csv --mechanism axis --unit m -o emps.json --json identify.json",
            "identify",
        ),
        youbot("compare emps.json emps.csv --json compare.json", "compare"),
        youbot(
            "diagnose emps.json emps.csv --mechanism axis -o better.json --json diagnose.json",
            "diagnose",
        ),
        youbot("add emps.json cogging emps.csv --mechanism axis --json add.json", "add"),
        Step((data, "again.csv", "--model", "emps.json"), "emps_to_log.py", "official error"),
    )
    return Case("axis_emps", steps, True, (data,))


def shipped_logs() -> Iterator[Case]:
    calibration, fitted, held_out = (
        f"shipped/{name}.csv.gz" for name in ("calibration", "multisine_a", "multisine_b")
    )
    steps = (
        youbot(f"doctor {calibration} {held_out} --json doctor.json", "doctor"),
        youbot(f"identify {calibration} -o model.json --json identify.json", "identify"),
        youbot(f"identify {calibration} {fitted} --json both.json", "identify both"),
        youbot(f"identify {calibration} --robust --json robust.json", "identify robust"),
        youbot(f"identify {calibration} --output-error --json refined.json", "output error"),
        youbot(f"compare model.json {held_out} --predictions p --json compare.json", "compare"),
        youbot(f"compare model.json {calibration} {held_out}", "compare fitted too"),
    )
    yield Case("shipped", steps, True, prepare=shipped)

    hidden = "shipped/hidden/calibration.csv.gz shipped/hidden/multisine_a.csv.gz"
    threads = {"YOUBOT_THREADS": "4"}
    steps = (
        youbot(f"diagnose paper {hidden} -o tilted.json --json diagnose.json", "diagnose"),
        youbot(f"diagnose paper {hidden} --json threads.json", "diagnose in threads", **threads),
        youbot(f"add tilted.json roller_inertia {hidden} --json add.json", "add"),
        youbot(f"identify {calibration} --model tilted.json --json again.json", "identify"),
        youbot(f"compare tilted.json {hidden} --json compare.json", "compare"),
        youbot(f"diagnose paper {fitted} --json one.json --next-motion next.json", "one log"),
        youbot("effects floor_tilt tether --equations"),
    )
    yield Case("shipped_hidden", steps, True, prepare=shipped)

    pictures = "--report report.html --plots plots"
    steps = (
        youbot(f"identify {calibration} -o model.json {pictures}", "identify"),
        youbot(f"compare model.json {held_out} {pictures}", "compare"),
        youbot(f"diagnose paper {hidden} --report report.html", "diagnose"),
        youbot(
            "evaluate --plant model.json --model model.json --controllers kinematic,computed_torque"
            f" --bands 1-2 --seeds 2 --duration 3 --jobs 1 {pictures}",
            "evaluate",
        ),
    )
    yield Case("reports", steps, prepare=shipped)
    yield Case("demo", (youbot("demo --output demo"),))


def made() -> Iterator[Case]:
    steps = (
        youbot("record a --motions multisine_a,III --rate 50 --seed 3 --json a.json", "plain"),
        youbot("record b --motions multisine_q --effect wheel_coulomb_friction --seed 1", "effect"),
        youbot("record c --motions I --format csv.gz --decimals 8 --speed-noise 0", "zipped"),
        youbot("record d --motions II --format parquet --rate 250", "parquet"),
        youbot("doctor c/I.csv.gz d/II.parquet --json doctor.json", "doctor"),
        youbot("identify a/multisine_a.csv -o model.json --json identify.json", "identify"),
        youbot("record e --plant model.json --motions multisine_b --rate 20", "own plant"),
        youbot(
            "record f --motions multisine_a --effect actuator_lag:time_constant=0.03"
            " --effect torque_delay:delay=0.02",
            "late",
        ),
        youbot("identify f/multisine_a.csv --json late.json", "identify late"),
    )
    yield Case("record", steps, True)

    tilt = "--effect floor_tilt:tilt_x=0.02,tilt_y=0"
    steps = (
        youbot(f"record a --plant contact --motions multisine_a --rate 50 {tilt}", "record"),
        youbot("record b --plant contact:friction=0.3,rollers=12 --motions multisine_q", "other"),
        youbot("identify a/multisine_a.csv --json identify.json", "identify"),
    )
    yield Case("record_contact", steps)


def control() -> Iterator[Case]:
    yield Case(
        "evaluate",
        (youbot("evaluate --suite prompt --seeds 2 --duration 6 --jobs 1 --json evaluate.json"),),
    )
    policies = "--controllers kinematic,computed_torque,pid,ppo,residual_ppo"
    short = "--bands 0.5-3 --duration 4 --jobs 1"
    steps = (
        youbot(f"evaluate {policies} --seeds 2 {short} --json evaluate.json", "policies"),
        youbot(
            f"evaluate --controllers pid,lqi --model known --seeds 1 {short} --delay 2 --lag 0.02"
            " --surprise payload_change:mass=5,x=0.1,y=0,time=2 --brief --json late.json",
            "late",
        ),
    )
    yield Case("evaluate_policies", steps, True)
    yield Case(
        "evaluate_diagnosed",
        (
            youbot(
                "evaluate --effect floor_tilt:tilt_x=0.02,tilt_y=0 --model identified,diagnosed"
                f" --controllers computed_torque,adaptive --seeds 2 {short} --json diagnosed.json"
            ),
        ),
    )
    yield Case(
        "evaluate_contact",
        (
            youbot(
                "evaluate --plant contact --model paper --controllers kinematic,computed_torque"
                " --seeds 1 --bands 1-2 --duration 3 --jobs 1 --json contact.json"
            ),
        ),
    )
    steps = (
        youbot("tune paper --runs 1 --duration 4 -o gains.json --json tune.json", "kinematic"),
        youbot("tune paper --controller pid --runs 1 --duration 4 --delay 2 -o pid.json", "pid"),
        youbot(
            f"evaluate --controllers gains.json,pid.json --model known --seeds 1 {short}",
            "evaluate",
        ),
    )
    yield Case("tune", steps, True)
    settings = (
        *("envs=4", "episode_length=0.5", "evaluations=2", "net_arch=[8]", "steps=512"),
        *("n_steps=32", "batch_size=64", "n_epochs=2"),
    )
    small = " ".join(f"--set {setting}" for setting in settings)
    steps = (
        youbot(f"train ppo {small} --seed 1 --output trained --json train.json", "ppo"),
        youbot(
            "evaluate --controllers trained/policy.json --model known --seeds 1 --duration 2"
            " --bands 1-2 --jobs 1",
            "evaluate",
        ),
    )
    yield Case("train", steps, True)
    yield Case("bench", (youbot("bench --cases 1 --jobs 1 --json bench.json"),))
    yield Case(
        "bench_cases",
        (youbot("bench --cases 1 --kinds floor_tilt --rates 50 --jobs 1 --write cases", "write"),),
    )


COMMANDS = (
    *("record", "doctor", "identify", "compare", "diagnose", "add", "evaluate", "train", "tune"),
    *("bench", "effects", "demo"),
)


def words() -> Iterator[Case]:
    """What the package says of itself."""
    steps = (
        youbot("effects --json effects.json", "list"),
        lines(
            "in words",
            (
                *("effects --equations", "effects --latex --equations", "effects floor_tilt"),
                "effects --mechanism axis --json axis.json",
                "effects wheel_coulomb_friction tether roller_inertia --equations",
                "effects --mechanism axis cogging --equations",
            ),
        ),
    )
    yield Case("effects", steps, True)
    helps = [f"{command} --help" for command in COMMANDS]
    yield Case("help", (lines("all", [*helps, "--help", "--version"]),), True)


def inside() -> Iterator[Case]:
    """Calls from Python."""
    names = {
        "models": ("models", "plants", "motions", "model_files"),
        "environments": ("environments",),
        "environment_options": ("own_options", "pictures"),
        "contact_plant": ("contact_plant",),
        "exports": ("step_functions", "control_systems", "torch_modules", "bodies"),
        "logs": ("logs", "observability", "recursive"),
        "policies": ("policies",),
    }
    first = youbot("identify shipped/calibration.csv.gz -o model.json", "identify")
    for name, functions in names.items():
        steps = tuple(Step((function,), "inside", function) for function in functions)
        before = (first,) if name == "environment_options" else ()
        yield Case(f"python_{name}", (*before, *steps), True, prepare=shipped)
    step = Step(("identification_calls",), "inside", "calls")
    yield Case("python_identification", (step,))


def cases() -> list[Case]:
    """All cases, the long ones first, so that none is left to run alone at the end."""
    folders = (*SIMULATED, *(f"wild/{n}" for n in WILD), *(f"field/{n}" for n in FIELD))
    return [
        *control(),
        *inside(),
        *bad_input.cases(),
        *shipped_logs(),
        *(folder_of_logs(name) for name in folders),
        *other_folders(),
        axis(),
        *made(),
        *words(),
    ]


def missing(case: Case, code: Code) -> list[str]:
    """Files of the data that a case needs and that are not there."""
    paths = (Path(need).relative_to("data") for need in case.needs)
    return [str(path) for path in paths if not (code.data / path).exists()]
