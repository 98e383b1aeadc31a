"""The map that a source suggests: what each column seems to be, why, and what stays undecided."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import permutations
from math import pi

import numpy as np

from identification.importing.assembling import assemble
from identification.importing.clock_columns import moves
from identification.importing.clocks import spread
from identification.importing.groups import (
    WheelGroup,
    gyro_columns,
    pose_groups,
    wheel_groups,
)
from identification.importing.import_map import (
    ROW,
    UNKNOWN,
    Channels,
    Gyro,
    ImportMap,
    Pose,
    Time,
)
from identification.importing.settings import ImportSettings
from identification.importing.tables import RECEIVED, Array, Table, rate_of, reference
from identification.importing.vocabulary import CURRENTS, EFFORT, POSITION, UNITS, VELOCITY
from identification.logs.findings import fault, percent
from youbot_env.physics import hardware

_PAIRS = np.array([1.0, 1.0, -1.0, -1.0])
"""Front less back wheels: their speeds add up to zero without slip."""

_LEFT_NEGATED = (-1.0, 1.0, -1.0, 1.0)


@dataclass
class Proposal:
    """A map, and how sure it is.

    Attributes
    ----------
    map : complete: what could not be decided is guessed in it
    remarks : why, by part of the map
    undecided : what a person must decide before the log can be trusted; empty if all is plain
    doubts : what is kept as it stands because nothing shows what it is
    """

    map: ImportMap
    remarks: dict[str, list[str]] = field(default_factory=dict)
    undecided: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def say(self, part: str, sentence: str) -> None:
        """Adds a reason."""
        self.remarks.setdefault(part, []).append(sentence)

    def ask(self, part: str, question: str) -> None:
        """Adds what could not be decided."""
        self.undecided.append(question)
        self.say(part, f"CHECK: {question}")

    def doubt(self, part: str, sentence: str) -> None:
        """Adds what is kept as it stands."""
        self.doubts.append(sentence)
        self.say(part, f"CHECK: {sentence}")


def propose(tables: list[Table], settings: ImportSettings = ImportSettings()) -> Proposal:
    """The map that the names, types and numbers of some tables suggest.

    Raises
    ------
    InputError
        If no four columns look like wheels.
    """
    groups = wheel_groups(tables)
    speeds = _speeds(groups, tables)
    found = Proposal(ImportMap(Channels(speeds.columns, "rad/s")))
    _propose_time(found, speeds, settings)
    _propose_pose(found, tables, settings)
    _propose_gyro(found, tables, settings)
    _propose_speeds(found, speeds, tables, settings)
    _propose_efforts(found, groups, tables, settings)
    _propose_positions(found, groups, speeds, tables, settings)
    return found


def _speeds(groups: list[WheelGroup], tables: list[Table]) -> WheelGroup:
    for quantity in (VELOCITY, POSITION, ""):
        for group in groups:
            if group.quantity == quantity and not group.wanted:
                return group
    columns = [name for table in tables for name in table.columns]
    shown = ", ".join(columns[:9]) + (", ..." if len(columns) > 9 else "")
    cure = (
        "name the four columns of the wheel speeds in a map: [velocity] fl, fr, bl, br "
        "(--map MAP.toml)"
    )
    raise fault(tables[0].source, f"no four columns look like wheel speeds among {shown}", cure)


# --- time ------------------------------------------------------------------------------------


def _propose_time(found: Proposal, speeds: WheelGroup, settings: ImportSettings) -> None:
    table = speeds.tables[0]
    clock = next(iter(table.clocks), "")
    if not clock:
        rate = settings.assumed_rate
        found.map = replace(found.map, time=Time(ROW, "", rate))
        candidates = [name for name in table.columns if "time" in name.lower()]
        seen = f" (column {candidates[0]} does not tell the rows apart)" if candidates else ""
        found.ask(
            "time", f"no column tells the time{seen}: rate of the rows? {rate:g} Hz is a guess"
        )
        return
    time = table.clocks[clock]
    unit = table.units.get(clock, "") if clock in table.columns else ""
    found.map = replace(found.map, time=Time(clock, unit, None))
    others = [name for name in table.clocks if name != clock]
    beside = f"; {', '.join(others)} is there too" if others else ""
    found.say("time", f"{clock}: {rate_of(time):.4g} Hz{f', in {unit}' if unit else ''}{beside}")
    if clock == RECEIVED:
        found.say("time", "the times of arrival: no stamp of measurement is in the messages")
    for question in table.questions:
        found.ask("time", question)
    if not moves(time) and spread(time[np.isfinite(time)]) is None:
        distinct = len(np.unique(time[np.isfinite(time)]))
        if distinct < settings.min_distinct_share * len(time):
            rate = settings.assumed_rate
            found.map = replace(found.map, time=Time(ROW, "", rate))
            found.ask(
                "time",
                f"column {clock} holds {distinct} different times in {len(time)} rows: rate of "
                f"the rows? {rate:g} Hz is a guess",
            )


# --- wheels ----------------------------------------------------------------------------------


def _propose_speeds(
    found: Proposal, group: WheelGroup, tables: list[Table], settings: ImportSettings
) -> None:
    found.say("velocity", f"{_named(group)}: the four wheels, up to {group.peak:.4g}")
    if not group.quantity:
        found.ask("velocity", "no name says what these columns are: wheel speeds?")
    unit, gear = _unit_of_speeds(found, group, settings)
    found.map = replace(found.map, velocity=Channels(group.columns, unit, gear))
    asked = _only(found.map, "velocity")
    # The order of the wheels shows at any size, so one that has to be asked for does no harm.
    sized = replace(asked.velocity, counts_per_turn=1.0, wheel_radius=1.0)
    values = assemble(replace(asked, velocity=sized), tables, settings).channels["velocity"]
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) > 1:
        _propose_order(found, group, values, settings)


def _named(group: WheelGroup) -> str:
    return ", ".join(group.columns)


def _unit_of_speeds(
    found: Proposal, group: WheelGroup, settings: ImportSettings
) -> tuple[str, float]:
    """Unit of the speeds, and the gear between motor and wheel."""
    if group.unit:
        found.say("velocity", f"unit {group.unit}: its header says so")
        return group.unit, 1.0
    if group.quantity == POSITION:
        peak = max(float(np.ptp(v[np.isfinite(v)])) for v in group.values)
        found.say("velocity", "no column holds speeds: positions are differenced")
        whole = all((v[np.isfinite(v)] % 1 == 0).all() for v in group.values)
        if whole and peak > settings.max_array:
            found.ask("velocity", "positions are counts: how many are a turn (counts_per_turn)?")
            return "count", 1.0
        return "rad", 1.0
    peak = group.peak
    if peak <= settings.max_speed:
        why = "ROS has it so" if group.is_joint_state else "the size is usual"
        found.say("velocity", f"unit rad/s: {why}, and no header says otherwise")
        return "rad/s", 1.0
    guesses = _guessed_units(peak, settings)
    told = ", ".join(
        f"{unit}{f' of a motor at {gear:g}:1' if gear != 1 else ''} ({size:.3g} rad/s)"
        for unit, gear, size in guesses[: settings.max_guesses]
    )
    sentence = (
        f"speeds up to {peak:.4g} are no rad/s of a wheel; they may be, the likeliest first, "
        f"{told}, or of a motor behind another gear"
    )
    if found.map.pose is not None or found.map.gyro is not None:
        found.doubt(
            "velocity",
            f"{sentence}: kept as they stand; `youbot kinematics` finds unit and gear by the pose",
        )
        return UNKNOWN, 1.0
    found.ask("velocity", f"{sentence}: unit and gear?")
    return guesses[0][:2] if guesses else (UNKNOWN, 1.0)


def _guessed_units(peak: float, settings: ImportSettings) -> list[tuple[str, float, float]]:
    """Units and gears at which a peak is a wheel's, with it in rad/s, the likeliest first."""
    gear = round(hardware.GEAR_RATIO, 2)
    trials = [("rpm", 1.0), ("deg/s", 1.0), ("rad/min", 1.0), ("rad/s", gear), ("rpm", gear)]
    sizes = [(unit, gear, peak * UNITS[unit][1] / gear) for unit, gear in trials]
    near = [one for one in sizes if settings.least_peak < one[2] <= settings.max_speed]
    return sorted(near, key=lambda one: abs(np.log(one[2] / settings.usual_peak)))


def _slip(values: Array) -> float:
    """Share of the speeds (n, 4) that the no-slip identity leaves over."""
    size = np.sqrt(np.mean((values**2).sum(axis=1)))
    return float(np.sqrt(np.mean((values @ _PAIRS / 2) ** 2)) / max(size, 1e-300))


def _propose_order(
    found: Proposal, group: WheelGroup, values: Array, settings: ImportSettings
) -> None:
    """Order and signs of the wheels, checked by phi_1' + phi_2' = phi_3' + phi_4'."""
    ratio = _slip(values)
    holds = ratio < settings.max_slip
    seen = f"phi_1' + phi_2' - phi_3' - phi_4' is {percent(ratio)} of the speeds"
    limit = min(settings.max_slip, settings.max_remaining_slip * ratio)
    if holds:
        if group.by_number:
            found.say("velocity", f"order fl, fr, bl, br assumed for numbers; {seen}, as it must")
        else:
            found.say("velocity", seen)
        return
    if _slip(values * _LEFT_NEGATED) < limit:
        _negate_left(found, seen)
        return
    if group.by_number:
        best, signed = (_best_order(values, sign) for sign in (np.ones(4), np.array(_LEFT_NEGATED)))
        if _slip(values[:, best]) < limit or _slip(values[:, signed] * _LEFT_NEGATED) < limit:
            negated = not _slip(values[:, best]) < limit
            order = signed if negated else best
            columns = tuple(group.columns[k] for k in order)
            sign = _LEFT_NEGATED if negated else (1.0, 1.0, 1.0, 1.0)
            found.map = replace(
                found.map, velocity=replace(found.map.velocity, columns=columns, sign=sign)
            )
            names = ", ".join(columns)
            found.ask("velocity", f"order of the numbered wheels: {names} would fit ({seen})")
            return
    found.doubt("velocity", f"{seen}: wheels slip, or names, signs or units are not what they seem")


def _best_order(values: Array, signs: Array) -> tuple[int, ...]:
    """The order (4,) of columns (n, 4), times signs (4,), in which they slip least.

    It is the first of those that tie: eight always do, since the identity is the same for
    wheels that are exchanged within a pair, and for the pairs. Their sums differ by rounding, which
    is not the same on all machines.
    """
    orders = list(permutations(range(4)))
    slips = np.array([_slip(values[:, order] * signs) for order in orders])
    return orders[int(np.flatnonzero(slips <= slips.min() * (1.0 + 1e-9) + 1e-12)[0])]


def _negate_left(found: Proposal, seen: str) -> None:
    """The stock driver's convention: the left wheels count against the way that they roll."""
    found.map = replace(found.map, velocity=replace(found.map.velocity, sign=_LEFT_NEGATED))
    found.say(
        "velocity",
        f"the left wheels are negated, as the stock driver has them: turned around ({seen} as they "
        "stand)",
    )


def _only(chosen: ImportMap, *parts: str) -> ImportMap:
    """A map with some of its parts."""
    kept = {name: getattr(chosen, name) for name in parts if name != "velocity"}
    return ImportMap(chosen.velocity, **kept, time=chosen.time)


# --- efforts and positions -------------------------------------------------------------------


def _propose_efforts(
    found: Proposal, groups: list[WheelGroup], tables: list[Table], settings: ImportSettings
) -> None:
    measured = [g for g in groups if g.quantity in (EFFORT, "current") and g.peak > 0]
    for quantity, wanted in (("effort", False), ("command", True)):
        # N m first: a current is a torque only by way of a constant.
        ranked = sorted(
            (g for g in measured if g.wanted == wanted), key=lambda g: g.quantity == "current"
        )
        if ranked:
            channels = _effort_channels(found, quantity, ranked[0], settings)
            found.map = replace(found.map, **{quantity: channels})
            if quantity == "effort":
                _sign_efforts(found, tables, settings)
    if found.map.effort is None:
        found.say("effort", "no effort: no column holds wheel torques or motor currents")


def _effort_channels(
    found: Proposal, part: str, group: WheelGroup, settings: ImportSettings
) -> Channels:
    found.say(part, f"{_named(group)}: up to {group.peak:.4g}")
    # Numbered columns were put in an order by their speeds.
    order = _order_of_speeds(found, group)
    columns = tuple(group.columns[k] for k in order)
    sign = found.map.velocity.sign
    unit = group.unit or ("A" if group.quantity == "current" else "")
    if unit in CURRENTS:
        youbot = all("wheel_joint" in name for name in columns)
        found.ask(
            part,
            f"{part} is a current ({unit}): which torque_constant [N m/A] and gear has the motor?"
            + (" those of the youBot are proposed" if youbot else ""),
        )
        constant = hardware.TORQUE_CONSTANT if youbot else None
        gear = round(hardware.GEAR_RATIO, 2) if youbot else 1.0
        return Channels(columns, unit, gear, sign, torque_constant=constant)
    if unit:
        found.say(part, f"unit {unit}: its header says so")
        return Channels(columns, unit, 1.0, sign)
    speeds = found.map.velocity
    if speeds.unit == UNKNOWN or speeds.gear != 1:
        constant, gear = hardware.TORQUE_CONSTANT, hardware.GEAR_RATIO
        found.doubt(
            part,
            f"{part} stands beside speeds of a motor, so it may be the motor's torque (N m, with "
            "gear) or current (A, with gear and torque_constant): left out until the map says "
            f"which; the youBot has torque_constant = {constant}, gear = {gear:.2f}",
        )
        return Channels(columns, UNKNOWN, 1.0, sign)
    if group.peak > settings.max_effort:
        found.ask(part, f"efforts up to {group.peak:.4g} are no N m of a wheel: which unit? mN m?")
        return Channels(columns, "mN m", 1.0, sign)
    why = "ROS has it so" if group.is_joint_state else "the name says torque"
    found.say(part, f"unit N m at the wheel: {why}, and no header says otherwise")
    return Channels(columns, "N m", 1.0, sign)


def _order_of_speeds(found: Proposal, group: WheelGroup) -> list[int]:
    """The order in which the speeds' numbered columns were put, if this group is numbered too."""
    speeds = found.map.velocity.columns
    if not group.by_number or sorted(speeds) == list(speeds):
        return [0, 1, 2, 3]
    ranks = sorted(range(4), key=lambda k: speeds[k])
    return [ranks.index(k) for k in range(4)]


def _sign_efforts(found: Proposal, tables: list[Table], settings: ImportSettings) -> None:
    """Signs of efforts follow those of speeds, unless their power says the contrary."""
    effort = found.map.effort
    if effort is None or effort.lacks() or found.map.velocity.sign != _LEFT_NEGATED:
        return
    made = assemble(_only(found.map, "effort"), tables, settings)
    if "effort" not in made.channels:
        return
    power = made.channels["velocity"] * made.channels["effort"]
    power = power[np.isfinite(power).all(axis=1)]
    share = power.sum(axis=0) / np.maximum(np.abs(power).sum(axis=0), 1e-300)
    left = share[[0, 2]].mean()
    if left < -settings.driving_power:
        found.map = replace(found.map, effort=replace(effort, sign=(1.0, 1.0, 1.0, 1.0)))
        found.say("effort", "of the left wheels not negated: their power is positive as it stands")
    else:
        found.say("effort", "of the left wheels negated with their speeds")


def _propose_positions(
    found: Proposal,
    groups: list[WheelGroup],
    speeds: WheelGroup,
    tables: list[Table],
    settings: ImportSettings,
) -> None:
    ranked = [g for g in groups if g.quantity == POSITION and not g.wanted and g.peak > 0]
    if not ranked or speeds.quantity == POSITION:
        return
    group = ranked[0]
    columns = tuple(group.columns[k] for k in _order_of_speeds(found, group))
    channels = Channels(columns, group.unit or "rad", sign=found.map.velocity.sign)
    found.say("position", f"{_named(group)}: up to {group.peak:.6g}")
    if channels.unit == "count":
        found.say("position", "counts: how many are a turn is not known, so they are left out")
        found.map = replace(found.map, position=channels)
        return
    trial = replace(found.map, position=channels)
    try:
        made = assemble(_only(trial, "position"), tables, settings)
    except ValueError:
        return
    ratio = _rate_ratio(made.time, made.channels["position"], made.channels["velocity"])
    found.map = replace(found.map, position=_scaled(found, channels, group, ratio, settings))


def _rate_ratio(time: Array, position: Array, velocity: Array) -> float:
    """Slope of the positions over the speeds (each (n, 4)), 1 where their units agree."""
    way = position - position[0]
    rolled = np.zeros_like(way)
    steps = np.diff(time)[:, None]
    rolled[1:] = np.cumsum((velocity[1:] + velocity[:-1]) / 2 * steps, axis=0)
    good = np.isfinite(way).all(axis=1) & np.isfinite(rolled).all(axis=1)
    square = float((rolled[good] ** 2).sum())
    return float((way[good] * rolled[good]).sum() / square) if square > 0 else float("nan")


def _scaled(
    found: Proposal,
    channels: Channels,
    group: WheelGroup,
    ratio: float,
    settings: ImportSettings,
) -> Channels | None:
    """The unit of positions that their slope over the speeds shows."""
    near = settings.max_unit_error
    if found.map.velocity.unit == UNKNOWN:
        found.doubt("position", "kept as they stand, like the speeds")
        return replace(channels, unit=UNKNOWN)
    if group.unit:
        found.say("position", f"unit {group.unit}: its header says so")
        return channels
    if abs(abs(ratio) - 1) < near:
        found.say("position", f"unit rad: they rise by {ratio:.3g} of the integrated speeds")
        return channels
    for unit in ("deg", "turn"):
        if abs(abs(ratio) * UNITS[unit][1] - 1) < near:
            found.say("position", f"unit {unit}: they rise by {ratio:.4g} of the speeds")
            return replace(channels, unit=unit)
    counts = abs(ratio) * 2 * pi
    whole = all((v[np.isfinite(v)] % 1 == 0).all() for v in group.values)
    if whole and counts > 1:
        found.say("position", f"counts: {counts:.6g} a turn by the integrated speeds")
        return replace(channels, unit="count", counts_per_turn=float(round(counts)))
    found.say("position", f"left out: they rise by {ratio:.3g} of the speeds, which is no unit")
    return None


# --- pose and gyro ---------------------------------------------------------------------------


def _propose_pose(found: Proposal, tables: list[Table], settings: ImportSettings) -> None:
    groups = pose_groups(tables)
    if not groups:
        found.say("pose", "no pose")
        return
    group = groups[0]
    table = group.table
    place = np.column_stack([table.columns[group.x], table.columns[group.y]])
    known = place[np.isfinite(place).all(axis=1)]
    span = float(np.ptp(known, axis=0).max()) if len(known) else 0.0
    unit = table.units.get(group.x, "") or ("mm" if span > settings.max_place else "m")
    found.say("pose", f"{table.topic or 'columns'} {', '.join(group.columns)}: spans {span:.3g}")
    if not table.units.get(group.x):
        why = "it would be too far in metres" if unit == "mm" else "no header says otherwise"
        found.say("pose", f"unit {unit}: {why}")
    yaw_unit = "rad"
    if group.yaw:
        largest = float(np.nanmax(np.abs(table.columns[group.yaw]), initial=0.0))
        stated = table.units.get(group.yaw, "")
        yaw_unit = stated or ("deg" if largest > settings.max_yaw else "rad")
        found.say("pose", f"yaw in {yaw_unit}, up to {largest:.3g}")
    others = [g.table.topic or g.x for g in groups[1:4]]
    if others:
        found.say("pose", f"also there: {', '.join(others)}")
    if "Odometry" in table.kind or "odom" in table.topic:
        found.doubt(
            "pose",
            f"{table.topic} is odometry: if it is computed from the wheels, it shows nothing about "
            "them",
        )
    named = [reference(table, column) for column in group.columns]
    yaw, quaternion = ("", tuple(named[2:])) if group.quaternion else (named[2], ())
    pose = Pose(named[0], named[1], yaw, quaternion, unit, yaw_unit)
    found.map = replace(found.map, pose=pose)


def _propose_gyro(found: Proposal, tables: list[Table], settings: ImportSettings) -> None:
    columns = gyro_columns(tables)
    if not columns:
        return
    table, column = columns[0]
    values = table.columns[column]
    peak = float(np.nanmax(np.abs(values), initial=0.0))
    unit = table.units.get(column, "") or ("deg/s" if peak > settings.max_yaw_rate else "rad/s")
    found.say("gyro", f"{reference(table, column)}: up to {peak:.3g}, in {unit}")
    found.map = replace(found.map, gyro=Gyro(reference(table, column), unit))
