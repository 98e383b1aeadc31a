"""Effects that a blind test plants: those of the catalogue, and some outside of it.

Sizes are drawn around a standard size (factor one), at which the base model's force error is 3 to
20 times its noise floor on logs like the given ones (``youbot bench --sizes`` measures it).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from youbot_scripts.blind_bench import draws, wheel_effects
from youbot_scripts.blind_bench.draws import WHEELS, Values
from youbot_scripts.blind_bench.second_simulator import Physics

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plantable:
    """An effect that can be planted.

    Attributes
    ----------
    size : of its main parameter at factor one
    unit : of that parameter
    draw : (rng, size, path) -> values by the catalogue's parameter names; ``path`` (n, 2) are
        places [m] that the reference motions pass
    plant : values -> fields of `Physics` that they set
    carriers : variables beyond the twist that the force of an effect outside the catalogue
        depends on
    family : effects of one family can hardly be told apart, so two of them are no pair
    on_shared_clock : whether it runs on over a session's logs
    site, reads : of what is outside the catalogue, where it acts and the variables that its law
        reads, as a proposal calls them: one of these variables is the main one
    """

    name: str
    size: float
    unit: str
    draw: Callable[[np.random.Generator, float, Array], Values]
    plant: Callable[[Values], dict[str, float | Array]]
    carriers: tuple[str, ...] = ()
    family: str = ""
    on_shared_clock: bool = False
    site: str = "world"
    reads: tuple[str, ...] = ()

    @property
    def main_variables(self) -> tuple[str, ...]:
        """What a right proposal reads, one of them at least."""
        return self.reads or self.carriers or ("twist",)


def _renamed(**fields: str) -> Callable[[Values], dict[str, float | Array]]:
    return lambda values: {field: values[name] for field, name in fields.items()}


def _as_named(values: Values) -> dict[str, float | Array]:
    return dict(values)


def _per_wheel(field: str, prefix: str) -> Callable[[Values], dict[str, float | Array]]:
    return lambda values: {field: np.array([values[f"{prefix}_{wheel}"] for wheel in WHEELS])}


CATALOGUE = {
    item.name: item
    for item in (
        Plantable(
            "wheel_coulomb_friction",
            0.25,
            "N m",
            draws.one_number("torque"),
            _renamed(coulomb="torque"),
            family="dry",
        ),
        Plantable(
            "wheel_stribeck_friction",
            0.15,
            "N m",
            draws.stribeck,
            _renamed(coulomb="torque", breakaway="breakaway", stribeck_speed="stribeck_speed"),
            family="dry",
        ),
        Plantable(
            "roller_coulomb_friction",
            0.03,
            "N m",
            draws.one_number("torque"),
            _renamed(roller_coulomb="torque"),
        ),
        Plantable(
            "quadratic_friction",
            0.01,
            "N m s^2",
            draws.one_number("coefficient"),
            _renamed(quadratic="coefficient"),
            family="dry",
        ),
        Plantable(
            "load_dependent_friction",
            0.3,
            "1",
            lambda rng, size, path: {"share": min(size, 0.8)},  # near one the wheels lock
            _renamed(load_share="share"),
        ),
        Plantable(
            "uneven_wheel_friction",
            0.1,
            "N m s",
            draws.uneven,
            _per_wheel("drag", "extra"),
            family="wheels",
        ),
        Plantable(
            "friction_warmup",
            0.5,
            "1",
            lambda rng, size, path: {"fraction": size, "time_constant": rng.uniform(15.0, 60.0)},
            _renamed(cold="fraction", warming_time="time_constant"),
        ),
        Plantable(
            "floor_tilt",
            0.018,
            "rad",
            lambda rng, size, path: draws.vector(rng, size, "tilt_x", "tilt_y"),
            _as_named,
            family="place",
        ),
        Plantable(
            "tether",
            5.0,
            "N/m",
            draws.tether,
            _renamed(tether="stiffness", anchor_x="anchor_x", anchor_y="anchor_y"),
            family="place",
        ),
        Plantable(
            "torque_gain_error",
            0.2,
            "1",
            draws.gains,
            _per_wheel("gain", "gain"),
            family="wheels",
        ),
        Plantable(
            "actuator_lag",
            0.1,
            "s",
            draws.one_number("time_constant"),
            _renamed(lag="time_constant"),
            family="late",
        ),
        Plantable(
            "torque_delay",
            0.1,
            "s",
            draws.one_number("delay"),
            lambda values: {},  # a fault of the log, applied in `cases.log_along`
            family="late",
        ),
        Plantable(
            "torque_ripple",
            0.25,
            "N m",
            draws.ripple,
            lambda values: {
                "ripple": values["amplitude"],
                "ripple_cycles": values["cycles"],
                **_per_wheel("ripple_phase", "phase")(values),
            },
        ),
        Plantable(
            "roller_inertia",
            1e-3,
            "kg m^2",
            draws.one_number("inertia"),
            _renamed(roller_inertia="inertia"),
            family="late",
        ),
        Plantable(
            "payload_change",
            20.0,
            "kg",
            draws.payload,
            _renamed(load="mass", load_x="x", load_y="y", load_time="time"),
        ),
        Plantable(
            "torque_offset",
            0.08,
            "N m",
            draws.offsets,
            _per_wheel("offset", "offset"),
            family="constant",
        ),
        Plantable(
            "torque_constant_drift",
            0.15,
            "1",
            draws.drift,
            _renamed(fall="fraction", fall_time="time_constant"),
            on_shared_clock=True,
        ),
        Plantable(
            "speed_dependent_gain",
            0.11,
            "1",
            draws.one_number("loss"),
            _renamed(back_emf="loss"),
            family="dry",
        ),
        Plantable(
            "torque_saturation",
            1.0 / 0.8,
            "1/(N m)",
            draws.limit,
            _renamed(torque_limit="limit"),
        ),
        Plantable("dead_zone", 0.1, "N m", draws.one_number("width"), _renamed(zone="width")),
        Plantable(
            "drive_resonance",
            1.0 / 25.0,
            "s/rad",
            draws.swing,
            _renamed(swing="frequency", swing_damping="damping"),
            family="late",
        ),
        Plantable(
            "uneven_coulomb_friction",
            0.25,
            "N m",
            draws.one_wheel,
            _per_wheel("dry", "extra"),
            family="dry",
        ),
        Plantable(
            "uneven_roller_friction",
            0.06,
            "N m",
            draws.one_wheel,
            _per_wheel("roller_dry", "extra"),
        ),
        Plantable(
            "asymmetric_friction",
            0.08,
            "N m",
            draws.asymmetric,
            _renamed(forward_dry="coulomb", forward_viscous="viscous"),
            family="constant",
        ),
        Plantable("yaw_scrub", 2.0, "N m", draws.one_number("torque"), _renamed(scrub="torque")),
        Plantable("cable_drag", 6.0, "N", draws.one_number("force"), _renamed(trail="force")),
        Plantable(
            "cable_twist",
            0.6,
            "N m/rad",
            draws.twist,
            _renamed(twist_stiffness="stiffness", twist_neutral="neutral"),
        ),
    )
}
"""The effects of the catalogue; parameters have the same meaning as there."""

KINEMATICS = {
    item.name: item
    for item in (
        Plantable(
            "wheel_radius_error",
            0.03,
            "1",
            wheel_effects.uneven_errors("error"),
            lambda values: {"radius": 1.0 + wheel_effects.per_wheel(values, "error")},
        ),
        Plantable(
            "roller_angle_error",
            0.035,
            "rad",
            wheel_effects.roller_angles,
            lambda values: {
                "roller_angle": 0.25 * np.pi + wheel_effects.per_wheel(values, "error")
            },
        ),
        # These are faults of the log, applied in `cases.log_along`.
        Plantable(
            "speed_gain_error", 0.03, "1", wheel_effects.uneven_errors("gain"), lambda values: {}
        ),
        Plantable("speed_filter", 0.05, "s", draws.one_number("time_constant"), lambda values: {}),
        Plantable("wheel_creep", 0.1, "rad/s/(N m)", draws.one_number("slip"), lambda values: {}),
    )
}
"""Effects of kinematics, a kind of their own."""

OUTSIDE = {
    item.name: item
    for item in (
        Plantable(
            "carpet_nap",
            10.0,
            "N",
            draws.directed,
            _renamed(nap="force", nap_direction="direction"),
            ("heading",),
        ),
        Plantable(
            "line_spring",
            8.0,
            "N/m",
            draws.line,
            _renamed(line_stiffness="stiffness", line_direction="direction", line_offset="offset"),
            ("position_x", "position_y"),
        ),
        Plantable(
            "sticky_patch",
            15.0,
            "N",
            draws.patch,
            _renamed(patch="force", patch_x="x", patch_y="y", patch_radius="radius"),
            ("position_x", "position_y"),
        ),
        Plantable(
            "wind",
            8.0,
            "N",
            draws.directed,
            _renamed(wind="force", wind_direction="direction"),
            ("heading",),
        ),
        Plantable(
            "sideways_drift",
            250.0,
            "N s^2/m^2",
            draws.one_number("coefficient"),
            _renamed(drift="coefficient"),
            (),
            site="body",
        ),
        Plantable(
            "bump",
            15.0,
            "N",
            draws.bump,
            _renamed(bump="force", bump_x="x", bump_y="y", bump_width="width"),
            ("position_x", "position_y"),
        ),
        Plantable(
            "floor_joints",
            8.0,
            "N",
            draws.joints,
            _renamed(joints="force", joint_distance="distance", joint_phase="phase"),
            ("position_x",),
        ),
    )
}
"""Effects outside the catalogue: the right answer is "unknown"."""

REGIMES = {
    item.name: item
    for item in (
        Plantable(
            "one_way_friction",
            0.4,
            "N m",
            draws.one_way,
            _renamed(one_way="torque", one_way_wheel="wheel", one_way_sign="sign"),
            tuple(f"wheel_speed_{wheel}" for wheel in WHEELS),
            site="wheel",
            reads=("wheel_speed",),
        ),
        Plantable(
            "late_drag",
            10.0,
            "N",
            draws.late,
            _renamed(late_drag="force", late_time="time"),
            ("time",),
        ),
    )
}
"""Effects outside the catalogue that act in a part of the motion, which a rule describes."""

STRANGE = {
    item.name: item
    for item in (
        Plantable("air_drag", 120.0, "N s^2/m^2", draws.one_number("coefficient"),
                  _renamed(air="coefficient"), site="body"),
        Plantable("cogging_wheel", 0.4, "N m", draws.cogging,
                  _renamed(cog="torque", cog_wheel="wheel", cog_cycles="cycles"),
                  tuple(f"wheel_angle_{wheel}" for wheel in WHEELS), site="wheel",
                  reads=("wheel_angle",)),
        Plantable("rubbing_at_a_speed", 0.3, "N m", draws.rubbing,
                  _renamed(rub="torque", rub_speed="speed", rub_width="width"), site="wheel",
                  reads=("wheel_speed",)),
        Plantable("magnetic_strip", 15.0, "N", draws.strip,
                  _renamed(strip="force", strip_x="x", strip_width="width"), ("position_x",)),
        Plantable("gust", 10.0, "N", draws.gust,
                  _renamed(gust="force", gust_direction="direction", gust_time="time",
                           gust_width="width"), ("time",)),
        Plantable("side_brush", 8.0, "N", draws.one_number("force"), _renamed(brush="force"),
                  site="body"),
        Plantable("heading_magnet", 1.5, "N m", draws.magnet,
                  _renamed(magnet="moment", magnet_neutral="neutral"), ("heading",)),
        Plantable("ramp", 8.0, "N", draws.ramp,
                  _renamed(ramp="force", ramp_direction="direction", ramp_edge="edge"),
                  ("position_x",)),
    )
}  # fmt: skip
"""More of these, of other sites and shapes: a law may be proposed for them."""

FOREIGN = {
    item.name: item
    for item in (
        Plantable("grain_drag", 16.0, "N", draws.directed,
                  _renamed(grain="force", grain_direction="direction"), ("heading",),
                  reads=("heading", "twist")),
        Plantable("woven_floor", 10.0, "N", draws.weave,
                  _renamed(weave_x="force_x", weave_y="force_y"), ("heading",)),
        Plantable("sticking_roller", 0.12, "N m", draws.sticking,
                  _renamed(sticking="torque", sticking_wheel="wheel", sticking_speed="speed",
                           sticking_width="width"), site="roller"),
        Plantable("springy_mat", 60.0, "N/m", draws.mat,
                  _renamed(mat="stiffness", mat_x="x", mat_y="y", mat_radius="radius"),
                  ("position_x", "position_y")),
        Plantable("growing_drag", 12.0, "N", draws.one_number("force"), _renamed(growing="force"),
                  ("time",)),
        Plantable("weak_drive", 0.4, "1", draws.weak,
                  _renamed(weak_drive="share", weak_edge="edge"),
                  tuple(f"torque_{wheel}" for wheel in WHEELS), site="wheel", reads=("torque",)),
        Plantable("soft_wall", 15.0, "N/m", draws.wall, _renamed(wall="stiffness", wall_x="edge"),
                  ("position_x",)),
        Plantable("eccentric_rub", 0.5, "N m", draws.any_wheel("torque"),
                  _renamed(rubbing="torque", rubbing_wheel="wheel"),
                  tuple(f"wheel_angle_{wheel}" for wheel in WHEELS), site="wheel",
                  reads=("wheel_angle", "wheel_speed")),
        Plantable("saddle_floor", 10.0, "N/m", draws.one_number("stiffness"),
                  _renamed(saddle="stiffness"), ("position_x", "position_y")),
        Plantable("side_fan", 2.5, "N m/m", draws.one_number("slope"), _renamed(fan="slope"),
                  ("position_x",)),
        Plantable("root_drag", 20.0, "N", draws.one_number("coefficient"),
                  _renamed(root_drag="coefficient"), site="body", reads=("twist",)),
        Plantable("carpet_pile", 8.0, "N m s", draws.pile,
                  _renamed(pile="coefficient", pile_direction="direction"), ("heading",),
                  reads=("heading", "twist")),
        Plantable("rough_floor", 0.25, "N m", draws.rough,
                  _renamed(rough="torque", rough_x="edge"), ("position_x",), site="wheel",
                  reads=("position_x", "wheel_speed")),
        Plantable("lame_drive", 0.5, "1", draws.lame,
                  _renamed(lame="share", lame_wheel="wheel", lame_phase="phase"),
                  tuple(f"wheel_angle_{wheel}" for wheel in WHEELS), site="wheel",
                  reads=("wheel_angle", "torque")),
        Plantable("failing_drive", 0.4, "1", draws.failing,
                  _renamed(failing="share", failing_wheel="wheel", failing_time="time"),
                  ("time",), site="wheel", reads=("torque", "time")),
        Plantable("battery_sag", 0.04, "1/(N m)", draws.one_number("share"), _renamed(sag="share"),
                  tuple(f"torque_{wheel}" for wheel in WHEELS), site="wheel", reads=("torque",)),
        Plantable("trailer", 12.0, "kg", draws.one_number("mass"),
                  _renamed(trailer="mass"), (), site="body",
                  reads=("acceleration",)),
        Plantable("tightening_rope", 12.0, "N", draws.directed,
                  _renamed(pulling="force", pulling_direction="direction"), ("time",)),
        Plantable("jet_on_board", 8.0, "N", draws.jet,
                  _renamed(jet="force", jet_direction="direction", jet_time="time"),
                  ("time",), site="body"),
        Plantable("whirl", 3.0, "N m", draws.whirl,
                  _renamed(whirl="moment", whirl_time="time", whirl_width="width"), ("time",)),
    )
}  # fmt: skip
"""Effects that the search was not built with: products of two variables, two directions at once,
shapes with a corner, one-sided torques, roots. The grammar has got laws since for all of them (see
`FORMS`)."""

FORMS = {
    "carpet_nap": ("dry_nap",),
    "line_spring": ("line_spring",),
    "sticky_patch": ("dry_drag_in_a_patch",),
    "wind": ("force_by_heading_2",),
    "sideways_drift": ("quadratic_x_to_y",),
    "bump": ("spot_that_pushes",),
    "floor_joints": ("ripple_of_floor",),
    "one_way_friction": ("uneven_forward_dry_wheel_friction", "uneven_backward_dry_wheel_friction"),
    "late_drag": ("dry_drag_from_a_time_on",),
    "air_drag": ("air_drag",),
    "cogging_wheel": ("uneven_ripple_of_wheels",),
    "rubbing_at_a_speed": ("at_peak_wheel_friction",),
    "magnetic_strip": ("strip_across_x",),
    "gust": ("pull_for_a_while",),
    "side_brush": ("levelling_drag_y",),
    "heading_magnet": ("moment_by_heading_2",),
    "ramp": ("pull_beyond_an_edge_in_x", "pull_before_an_edge_in_x"),
    "grain_drag": ("dry_drag_by_heading_1",),
    "woven_floor": ("dry_along_and_across",),
    "sticking_roller": ("uneven_at_peak_roller_friction",),
    "growing_drag": ("dry_drag_that_grows",),
    "weak_drive": ("forward_load_beyond_an_edge",),
    "soft_wall": ("spring_beyond_an_edge_in_x",),
    "carpet_pile": ("viscous_turning_by_heading_2",),
    "side_fan": ("moment_by_place",),
    "root_drag": ("root_drag",),
    "springy_mat": ("spring_in_a_patch",),
    "saddle_floor": ("saddle",),
    "eccentric_rub": ("uneven_dry_wheel_friction_by_angle_1",),
    "rough_floor": ("dry_wheel_friction_beyond_an_edge_in_x",),
    "lame_drive": ("uneven_lost_torque_by_angle_1",),
    "failing_drive": ("uneven_late_lost_torque",),
    "battery_sag": ("loss_under_common_load",),
    "trailer": ("inertia_along_x",),
    "tightening_rope": ("pull_that_grows",),
    "jet_on_board": ("late_push_on_board",),
    "whirl": ("turning_for_a_while",),
}
"""Of the laws outside the catalogue, the laws of the grammar that state them."""

BEYOND = OUTSIDE | REGIMES | STRANGE
"""Effects outside the catalogue, each of which a law of the grammar states."""

LAWS = BEYOND | FOREIGN
"""Everything that no name of the catalogue explains."""

EVERYTHING = CATALOGUE | KINEMATICS | LAWS

DIFFER: dict[str, tuple[float, Values]] = {
    "floor_tilt": (1.0, {}),
    "payload_change": (0.35, {"time": 0.0}),
    "tether": (1.0, {}),
    "friction_warmup": (1.0, {}),
}
"""Effects of the catalogue that are planted in some logs only: how many times their size, and what
is not drawn of them. A load that is on from the start shows at once."""


@dataclass(frozen=True)
class Planted:
    """One thing planted: values by the catalogue's parameter names, ``factor`` times its size.

    logs : in which it is planted; () for all
    """

    name: str
    factor: float
    values: Values
    logs: tuple[str, ...] = ()


def draw(name: str, factor: float, rng: np.random.Generator, path: Array) -> Planted:
    """Draw what is planted under a name, at ``factor`` times its size."""
    item = EVERYTHING[name]
    values = item.draw(rng, factor * item.size, path)
    return Planted(name, factor, {key: float(value) for key, value in values.items()})


def planted_physics(base: Physics, planted: tuple[Planted, ...], log: str = "") -> Physics:
    """The platform with all that is planted in a log; without its name, with what all have."""
    for item in planted:
        if item.logs and log not in item.logs:
            continue
        base = base._replace(**EVERYTHING[item.name].plant(item.values))
    return base


def pairs() -> list[tuple[str, str]]:
    """Pairs of effects that can be told apart, which are not of one family."""
    names = list(CATALOGUE)
    return [
        (a, b)
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if not CATALOGUE[a].family or CATALOGUE[a].family != CATALOGUE[b].family
    ]
