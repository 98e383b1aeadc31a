"""Tables and charts of a benchmark, for terminal and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.benchmarks.speed import Speed
from youbot_scripts.shared.tables import Column, Table, columns

if TYPE_CHECKING:
    from identification.figures.chart_style import Chart
    from youbot_scripts.shared.report_page import Part


SHORT = {"one environment": "single"}
"""Names of cases in the table, which must fit 80 columns."""


def speed_table(found: Sequence[Speed]) -> Table:
    """Ours beside the peer, a row a case."""
    million = Column("million\nsteps/s", lambda rate: f"{rate / 1e6:.2f}")
    peer = Column("CartPole", lambda rate: f"{rate / 1e6:.2f}")
    ratio = Column("times\nas fast", lambda value: f"{value:.2f}")
    rows = tuple(
        (
            *(
                SHORT.get(row.case, row.case),
                row.copies,
                row.threads,
                row.effects,
                row.rate,
                row.peer_rate,
                row.ratio,
            ),
            "" if row.bytes_a_copy is None else str(row.bytes_a_copy),
        )
        for row in found
    )
    shown = columns("case", "copies", "threads", "effects", million, peer, ratio, "bytes\na copy")
    return Table("Speed beside CartPole-v1, in turns", shown, rows)


def import_table(imports: Mapping[str, float]) -> Table:
    """Seconds of a new Python."""
    seconds = Column("seconds", lambda value: f"{value:.2f}")
    return Table("In a new Python", columns("what", seconds), tuple(imports.items()))


def in_words(row: Speed) -> str:
    """A case in a few words, as a chart's row names it."""
    if row.copies == 1 and row.bytes_a_copy is None:
        return row.case
    more = [f"{row.threads} threads"] if row.threads > 1 else []
    more += [f"{row.effects} effect{'s' if row.effects > 1 else ''}"] if row.effects else []
    return ", ".join([f"{row.copies} at once", *more])


def write_report(
    path: Path, found: Sequence[Speed], imports: Mapping[str, float], machine: Mapping[str, Any]
) -> None:
    """Write the page of a benchmark.

    Raises
    ------
    InputError
        If the file cannot be written, or a library of the extra `plots` is missing.
    """
    from youbot_scripts.shared.report_page import write_page

    write_page(path, "Speed beside Gymnasium's CartPole-v1", _parts(found, imports, machine), None)


def _parts(
    found: Sequence[Speed], imports: Mapping[str, float], machine: Mapping[str, Any]
) -> Iterator[Part]:
    from youbot_scripts.shared.report_page import Charts, Words

    fastest = max(found, key=lambda row: row.rate)
    one = found[0]
    yield Words(
        [
            f"One environment: {one.rate / 1e3:.3g} thousand steps a second, {one.ratio:.2f} times "
            f"as fast as CartPole-v1; most: {fastest.rate / 1e6:.3g} million a second "
            f"({in_words(fastest)})"
        ],
        "verdict",
    )
    load = "" if not machine.get("load") else f", load {machine['load'][0]:.1f}"
    yield Words([f"{machine['processor']}, {machine['cores']} cores{load}"])
    yield Charts([rates_chart(found)])
    yield Charts([ratios_chart(found)])
    yield speed_table(found)
    if imports:
        yield import_table(imports)


def rates_chart(found: Sequence[Speed]) -> Chart:
    """Steps a second of ours and of the peer."""
    from identification.figures import chart_style as look
    from identification.figures.chart_style import Chart
    from identification.figures.interval_charts import Spread, add_spreads, height_of, name_rows

    height = height_of(len(found), 1, 2)
    figure = look.rows_figure(1, height)
    names = [in_words(row) for row in found]
    for series, beside, colour, rates in (
        ("this environment", -0.15, look.WORST, [row.rate for row in found]),
        ("CartPole-v1", 0.15, look.BAR, [row.peer_rate for row in found]),
    ):
        spreads = [Spread(name, rate / 1e6) for name, rate in zip(names, rates, strict=True)]
        mark = {"color": colour, "size": 10}
        add_spreads(
            figure, 1, spreads, series, mark, beside=beside, legend=True, unit="million steps/s"
        )
    name_rows(figure, 1, names)
    every = [rate / 1e6 for row in found for rate in (row.rate, row.peer_rate)]
    figure.update_xaxes(**look.log_axis(every), title_text="million steps/s", row=1, col=1)
    return Chart("rates", "Steps a second", figure, height)


def ratios_chart(found: Sequence[Speed]) -> Chart:
    """How many times as fast as the peer; dotted: as fast."""
    from identification.figures import chart_style as look
    from identification.figures.chart_style import Chart
    from identification.figures.interval_charts import height_of, name_rows

    height = height_of(len(found))
    figure = look.rows_figure(1, height)
    names = [in_words(row) for row in found]
    figure.add_trace(
        look.plotly().Bar(
            y=list(range(len(found))), x=[row.ratio for row in found], orientation="h", text=names,
            marker_color=[look.WORST if row.ratio < 1 else look.AXES[2] for row in found],
            textposition="none", hovertemplate="%{text}: %{x:.2f} times<extra></extra>",
        )
    )  # fmt: skip
    look.add_vertical(figure, 1, 1.0)
    name_rows(figure, 1, names)
    figure.update_xaxes(title_text="times as fast as CartPole-v1", rangemode="tozero")
    title = "Times as fast as CartPole-v1 of as many copies, in turns"
    return Chart("ratios", title, figure, height)
