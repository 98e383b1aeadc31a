"""Tables of results, made from their JSON form, so that terminal and page show the same numbers.

``found`` is the result of ``to_dict``, or a part of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from youbot_env.physics.effect import in_brackets, shown_unit
from youbot_scripts.shared.tables import (
    Column,
    Table,
    columns,
    decimals,
    number,
    percent,
    text,
    to_digit_of,
    unit,
    with_std,
)

if TYPE_CHECKING:
    from identification.logs.log import Log

Found = Mapping[str, Any]
Errors = Mapping[str, float]

ADEQUATE = "The residual depends on no variable more than chance would have it."
TOO_SHORT = "The logs are too short to tell."


# --- words -----------------------------------------------------------------------------------


def verdict(error: float, floor: float) -> str:
    """A model's force error beside its noise floor, in words."""
    from identification.fitting.misfit import misfit

    left = f"The model leaves {percent(error)} of the forces unexplained"
    noise = f"measurement noise alone would leave {percent(floor)}"
    if not misfit(error, floor):
        return f"{left}; {noise}: it fits."
    return (
        f"{left}; {noise}: it does not fit. `youbot diagnose` names what is missing, or says that "
        "it cannot."
    )


def x_legend(names: Sequence[str], scaling: str = "as in the paper") -> str:
    """Which parameter each x1, x2, ... stands for."""
    pairs = (f"x{k + 1} {name}" for k, name in enumerate(names))
    return f"x, scaled {scaling}: {', '.join(pairs)}"


# --- models ----------------------------------------------------------------------------------


def parameters(found: Mapping[str, Found], title: str = "Parameters") -> Table:
    """Values with standard deviation and 95 % interval.

    Parameters
    ----------
    found : by name value, std, interval (None where there is none) and unit
    """
    rows = tuple((name, entry, entry, shown_unit(entry["unit"])) for name, entry in found.items())
    shown = (Column("value", _estimate), Column("95 % interval", _interval), unit())
    return Table(title, (unit("name"), *shown), rows)


def parameters_with_law(joint: Mapping[str, Found], written: Mapping[str, Found]) -> Table:
    """Values as fitted with a proposed law, and as the model that a diagnosis writes has them.

    Parameters
    ----------
    joint, written : as :func:`parameters` takes them; the written model lacks the law's own
    """
    rows = tuple(
        (name, entry, entry, written.get(name, NOTHING), shown_unit(entry["unit"]))
        for name, entry in joint.items()
    )
    shown = (
        Column("with the\nproposed law", _estimate),
        Column("95 % interval", _interval),
        Column("without it", _estimate),
        unit(),
    )
    notes = (
        "Without it: as in the model that `-o` writes. A part of what the law explains is in these "
        "numbers.",
    )
    return Table("Refitted parameters", (unit("name"), *shown), rows, notes)


NOTHING: Found = {"value": None, "std": None}


def _estimate(entry: Found) -> str:
    if not _is_estimated(entry):
        return number(entry["value"])
    # Without an interval the deviation does not hold either; the digits are those of the value.
    if entry.get("interval", ...) is None:
        return to_digit_of(entry["value"], entry["std"])
    return with_std(entry["value"], entry["std"])


def _interval(entry: Found) -> str:
    if not _is_estimated(entry) or entry["interval"] is None:
        return "-"
    return " ... ".join(to_digit_of(bound, entry["std"]) for bound in entry["interval"])


def _is_estimated(entry: Found) -> bool:
    return entry["std"] is not None and 0 < entry["std"] < math.inf


def added_parameters(found: Found) -> Table:
    """The parameters of an effect that was added; of a map of the residual its curve."""
    if found.get("curve"):
        return _map_curve(found)
    rows = tuple(
        (name, entry, shown_unit(entry["unit"])) for name, entry in found["parameters"].items()
    )
    return Table(found["effect"], columns("parameter", Column("value", _estimate), unit()), rows)


def _map_curve(found: Found) -> Table:
    rows, parts = found["curve"], [key for key in found["curve"][0] if key not in ("at", "unit")]
    shown = [Column(in_brackets(part, rows[0][part]["unit"]), _estimate) for part in parts]
    first = in_brackets(found["effect"].partition(":")[2].replace("_", " "), rows[0]["unit"])
    values = tuple((number(row["at"], 3), *(row[part] for part in parts)) for row in rows)
    return Table(found["effect"], columns(first, *shown), values)


# --- errors ----------------------------------------------------------------------------------


def errors(title: str, rows: Iterable[tuple[str, Errors]], first: str = "with") -> Table:
    """Force and velocity errors, a row each; what is missing or no number is "-"."""
    kinds = ("force_error", "velocity_error")
    values = tuple((name, *(found.get(kind, math.nan) for kind in kinds)) for name, found in rows)
    shown = (Column("force error", percent), Column("velocity error", percent))
    return Table(title, columns(first, *shown), values)


def errors_by_axis(found: Found) -> list[Table]:
    """Force and velocity errors of a comparison by log and axis, beside the noise floor."""
    titles = {"force": "Force error", "velocity": "Velocity error (free run)"}
    return [_errors_by_axis(found, f"{kind}_error", title) for kind, title in titles.items()]


def _errors_by_axis(found: Found, kind: str, title: str) -> Table:
    logs = found["logs"]
    axes = tuple(next(iter(logs.values()))[f"{kind}_by_axis"])
    rows = [
        (
            name + (" (fitted on)" if entry["seen_in_fit"] else ""),
            *entry[f"{kind}_by_axis"].values(),
            entry[kind],
            entry["noise_floor"][kind],
        )
        for name, entry in logs.items()
    ]
    if len(rows) > 1:
        rows.append(("total", *[""] * len(axes), found["total"][kind], found["noise_floor"][kind]))
    shown = (Column(header, percent) for header in (*axes, "all", "noise floor"))
    return Table(title, columns("log", *shown), tuple(rows))


def steps(found: Found) -> Table:
    """The errors of a diagnosis, from the refitted model to the last effect that was accepted, and
    to the law that is proposed beside them."""
    rows = [(step["effect"] or "the model, refitted", step) for step in found["steps"]]
    if found.get("proposal"):
        rows.append((f"{found['proposal']['name']} (proposed)", found["proposal"]))
    return errors("The error as it falls", [*rows, ("noise floor", found["noise_floor"])])


def addition_errors(found: Found) -> Table:
    """Held-out errors without and with an effect that was added."""
    names = {"before": "before", "after": f"with {found['effect']}", "noise_floor": "noise floor"}
    return errors("Held-out errors", ((name, found[key]) for key, name in names.items()), first="")


# --- where a model fails ---------------------------------------------------------------------


def slip(logs: Mapping[str, Found]) -> list[Table]:
    """Whether the wheel speeds fulfil the identity of rolling without slip; [] for an axis."""
    rows = tuple(
        (name, slip["ratio"], slip["noise"], "broken" if slip["exceeds_noise"] else "holds")
        for name, entry in logs.items()
        if (slip := entry.get("slip"))
    )
    title = "No slip: phi_1' + phi_2' = phi_3' + phi_4' (share of wheel speeds)"
    shown = (Column("off by", percent), Column("noise alone", percent), "identity")
    return [Table(title, columns("log", *shown), rows)] if rows else []


def residual(title: str, where: Sequence[Found]) -> Table:
    """Variables that explain a share of the force residual; if there is none, a note says so."""
    rows = tuple((_variable(row), row["share"]) for row in where if row["share"] > 0)
    notes = () if rows else (ADEQUATE if where else TOO_SHORT,)
    share = Column("held-out share of variance", percent)
    return Table(title, columns("variable (others: beyond the twist)", share), rows, notes)


def _variable(row: Found) -> str:
    return row["variable"] + (f" ({row['cycles']} times a turn)" if row.get("cycles") else "")


def leading_variables(
    where: Sequence[Found], most: int = 6, *, title: str = "Residual by variable"
) -> list[Table]:
    """The variables with the largest shares of the residual; [] where none has one."""
    rows = tuple((row["variable"], row["share"]) for row in where if row["share"] > 0)[:most]
    shown = columns("variable", Column("share of it", percent))
    return [Table(title, shown, rows)] if rows else []


def stretches(found: Found) -> Table:
    """The stretches of the logs with the largest residual."""
    rows = tuple(
        (row["log"], row["axis"], row, row["force_error"], row["share"])
        for row in found["stretches"]
    )
    shown = (text("axis"), Column("stretch", lambda row: f"{row['from']:.1f}-{row['to']:.1f} s"))
    shares = (Column("force error", percent), Column("share of all", percent))
    return Table("Where the residual is largest", columns("log", *shown, *shares), rows)


def candidates(found: Found, most: int | None = None) -> Table:
    """The effects that were tried, best first."""
    rows = tuple(
        (row["effect"], row["force_error"], row["p_value"], row["parameters"])
        for row in found["candidates"][:most]
    )
    shown = (
        Column("force error", percent),
        Column("p", lambda p: number(p, 2)),
        Column("sizes", _sizes, is_text=True),
    )
    notes = (WITHOUT_LAW,) if found.get("proposal") and found["missing"] else ()
    return Table("Candidates, best first", columns("effect", *shown), rows, notes)


WITHOUT_LAW = "Sizes are fitted without the proposed law; the verdict tells those with it."


def _sizes(found: Mapping[str, Found]) -> str:
    return ", ".join(f"{name} {number(entry['value'], 3)}" for name, entry in found.items())


def laws(proposal: Found) -> Table:
    """Laws beyond the catalogue, of each length the best, with the squares that it leaves."""
    rows = tuple(
        (row["name"], row["length"], row["left"], row["formula"]) for row in proposal["pareto"]
    )
    shown = ("length", Column("leaves", percent), text("force"))
    return Table("Laws beyond the catalogue, by length", columns("law", *shown), rows)


# --- logs ------------------------------------------------------------------------------------


def logs(read: Iterable[Log]) -> Table:
    """The logs on which a page is based, with their hashes."""
    rows = tuple((log.name, len(log), log.duration, log.rate, log.sha256 or "-") for log in read)
    shown = ("rows", Column("duration s", decimals(1)), Column("Hz", number), text("sha256"))
    return Table("Logs", columns("log", *shown), rows)


def recorded_logs(title: str, rows: Mapping[str, Found]) -> Table:
    """Logs that were recorded, by file name, with the peaks of their motion."""
    shown = {
        "duration": Column("duration s", decimals(1)),
        "rows": Column("rows"),
        "peak_wheel_speed": Column("peak rad/s", decimals(2)),
        "peak_torque": Column("peak N m", decimals(2)),
        "saturated": Column("saturated %", lambda share: f"{100 * share:.1f}"),
    }
    values = tuple((name, *(row[key] for key in shown)) for name, row in rows.items())
    return Table(title, columns("log", *shown.values()), values)


def observability(found: Found, scaling: str) -> Table:
    """What each motion in the logs shows of the parameters that were fitted."""
    total = found["total"]
    symbols = {name: f"x{k + 1}" for k, name in enumerate(total["names"])}
    rows = tuple(
        (
            part["log"],
            part["kind"],
            _stretch(part),
            part["rank"],
            ", ".join(part["blind"]) or "-",
            " ".join("{" + ", ".join(symbols[n] for n in block) + "}" for block in part["blocks"]),
        )
        for part in found["parts"]
    )
    shown = (text("motion"), "stretch", "rank", text("blind to"), text("blocks"))
    legend = f"{x_legend(total['names'], scaling)}; all together: rank {total['rank']}"
    blocks = "blocks: what stands in one bracket can be estimated apart from the others"
    return Table("What each motion shows", columns("log", *shown), rows, (legend, blocks))


def motions_of_log(found: Found) -> Table:
    """What each motion of one log shows of the base model."""
    rows = tuple(
        (part["kind"], _stretch(part), part["rank"], ", ".join(part["blind"]) or "-")
        for part in found["parts"]
    )
    return Table("", columns("motion", "stretch", "rank", text("blind to")), rows)


def _stretch(part: Found) -> str:
    return f"{part['from']:.0f}-{part['to']:.0f} s"
