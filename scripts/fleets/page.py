"""Tables and charts of a fleet, for terminal and page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from youbot_scripts.fleets.records import Record
from youbot_scripts.fleets.summary import Cost, FleetSummary
from youbot_scripts.shared.report_page import Charts, Part, Words, write_page
from youbot_scripts.shared.tables import Column, Table, columns, number, text

if TYPE_CHECKING:
    from identification.figures.chart_style import Chart


CHART_HEIGHT, PANEL_HEIGHT, BAR_HEIGHT = 420, 150, 22
"""[px]"""


def headline(found: FleetSummary) -> str:
    """The verdicts in one line."""
    told = [f"{count} {verdict}" for verdict, count in sorted(found.verdicts.items())]
    told += [f"{len(found.unread)} could not be diagnosed"] if found.unread else []
    return f"{sum(found.verdicts.values()) + len(found.unread)} robots: {', '.join(told)}"


def screen_lines(found: FleetSummary) -> list[str]:
    """What the screen passed, and how often it was wrong where that was looked at."""
    passed, misses = found.by.get("screen", 0), found.misses
    if not misses.total:
        return [f"{passed} robots passed the screen; none of them was diagnosed in full"]
    share = f"at most {misses.interval()[1]:.0%}"
    return [
        f"{passed} robots passed the screen alone; of {misses.total} more that passed and were "
        f"diagnosed all the same, {misses.count} lacked something ({share}, 95 %)"
    ]


def cost_lines(cost: Cost) -> list[str]:
    """What a robot took, and 10,000 would."""
    told = [
        f"{seconds:.2f} s {how}"
        for seconds, how in ((cost.screened, "screened"), (cost.diagnosed, "diagnosed"))
        if seconds is not None
    ]
    line = f"CPU time of a robot: {', '.join(told)}; " if told else ""
    return [f"{line}10,000 robots like these: {cost.of_many:.1f} hours of one core"]


def tables(found: FleetSummary, most: int | None = None) -> Iterator[Table]:
    """Effects, findings, outliers, and what could not be read; ``most`` rows of each list."""
    rate = f"{found.settings.false_discovery_rate:.0%}"
    if found.findings:
        rows = [(row["effect"], row["robots"], row["named"]) for row in found.effects]
        head = columns("effect", f"robots at FDR {rate}", "named in")
        yield Table("What is missing, by effect", head, tuple(rows))
        findings = [
            (f.robot, f.effect, number(f.p_value, 2), "" if f.beyond_chance else "may be chance")
            for f in found.findings
        ]
        head = (text("robot"), text("effect"), Column("p"), text(""))
        yield _cut("What is missing, by robot", head, findings, most)
    if found.outliers:
        rows = [
            (
                o.robot,
                o.parameter,
                number(o.value),
                number(o.median),
                o.unit,
                f"{o.deviations:+.1f}",
            )
            for o in found.outliers
        ]
        head = (
            text("robot"), text("parameter"), Column("value"), Column("fleet's median"),
            text("unit"), Column("robust z", "{:+.1f}".format),
        )  # fmt: skip
        yield _cut("Parameters far from the fleet's", head, rows, most)
    head = (text("robot"), text("log"), text("reason"))
    unread = [(name, "all", reason) for name, reason in found.unread]
    unread += list(found.set_aside)
    if unread:
        yield _cut("Logs that could not be read", head, unread, most)


def _cut(
    title: str, head: tuple[Column, ...], rows: Sequence[tuple[object, ...]], most: int | None
) -> Table:
    left = len(rows) - most if most is not None and len(rows) > most else 0
    notes = (f"and {left} more, in the page and the JSON",) if left else ()
    return Table(title, head, tuple(rows[:most]), notes)


def robots_table(records: Sequence[Record]) -> Table:
    """Each robot with its verdict."""
    rows = tuple(
        (
            record["robot"],
            record.get("verdict", "not diagnosed"),
            ", ".join(record.get("missing", [])),
            record.get("by", ""),
            _percent(record.get("force_error")),
            _percent(record.get("noise_floor")),
        )
        for record in records
    )
    head = (
        text("robot"), text("verdict"), text("missing"), text("by"),
        Column("force error"), Column("noise floor"),
    )  # fmt: skip
    return Table("The robots", head, rows)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2f} %"


def write_report(
    path: Path, model: str, records: Sequence[Record], found: FleetSummary, cost: Cost, seed: int
) -> None:
    """Write the fleet's page.

    Raises
    ------
    InputError
        If the file cannot be written, or a library of the extra `plots` is missing.
    """
    parts = _parts(records, found, cost)
    write_page(path, f"What is missing in {len(records)} robots: {model}", parts, seed)


def _parts(records: Sequence[Record], found: FleetSummary, cost: Cost) -> Iterator[Part]:
    yield Words([headline(found)], "verdict")
    yield Words([*screen_lines(found), *cost_lines(cost)])
    charts = list(_charts(records, found))
    of_effects, of_robots = charts[:-1], charts[-1:]
    if of_effects:
        yield Charts(of_effects)
    yield from tables(found)
    if records:
        yield Charts(of_robots)
    yield robots_table(records)


def _charts(records: Sequence[Record], found: FleetSummary) -> Iterator[Chart]:
    """Robots by effect, where there is any; parameters over the fleet."""
    from identification.figures import chart_style as look
    from identification.figures.chart_style import Chart

    objects = look.plotly()
    if found.findings:
        rows = found.effects
        names = [row["effect"].replace("_", " ") for row in rows]
        more = [row["named"] - row["robots"] for row in rows]
        figure = objects.Figure([
            objects.Bar(
                y=names, x=[row["robots"] for row in rows], orientation="h",
                name="beyond chance in this fleet", marker_color=look.WORST,
            ),
            objects.Bar(
                y=names, x=more, orientation="h", name="may be chance", marker_color=look.BAR
            ),
        ])  # fmt: skip
        figure.update_layout(barmode="stack")
        # Every name is read: plotly leaves out those that have no room, or that it thinks dense.
        figure.update_yaxes(autorange="reversed", tickmode="linear", dtick=1)
        # Whole robots alone: half a robot is no number on an axis.
        step = max(1, max(row["named"] for row in rows) // 8)
        figure.update_xaxes(title_text="robots", dtick=step)
        height = max(CHART_HEIGHT, 180 + BAR_HEIGHT * len(rows))
        yield Chart("effects", "Effects in the fleet", look.finished(figure, height), height)
    yield _parameters_chart(records, found)


def _parameters_chart(records: Sequence[Record], found: FleetSummary) -> Chart:
    """Every common parameter of every robot, a panel each; outliers marked."""
    from identification.figures import chart_style as look
    from identification.figures.chart_style import Chart
    from youbot_scripts.fleets.summary import common_parameters

    objects = look.plotly()
    read = [record for record in records if "error" not in record]
    names = common_parameters(read)
    far = {(item.robot, item.parameter) for item in found.outliers}
    height = 120 + PANEL_HEIGHT * max(len(names), 1)
    units = {name: read[0]["parameters"][name]["unit"] for name in names}
    titles = [look.parameter(name, units[name]) for name in names]
    figure = look.rows_figure(max(len(names), 1), height, titles, shared=True)
    robots = [look.safe(record["robot"]) for record in read]
    for row, name in enumerate(names, start=1):
        colours = [look.WORST if (record["robot"], name) in far else look.BAR for record in read]
        figure.add_trace(
            objects.Scatter(
                x=list(range(1, len(read) + 1)),
                y=[record["parameters"][name]["value"] for record in read],
                mode="markers", marker={"color": colours, "size": 6}, text=robots,
                hovertemplate="%{text}: %{y:.4g}<extra></extra>", showlegend=False,
            ),
            row=row, col=1,
        )  # fmt: skip
    figure.update_yaxes(zeroline=False)
    figure.update_xaxes(title_text="robot, by name", row=max(len(names), 1), col=1)
    return Chart("parameters", "Parameters of the robots", figure, height)
