"""Charts and page of a benchmark."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from youbot_scripts.benchmarks.speed import Speed
from youbot_scripts.shared.tables import Table

if TYPE_CHECKING:
    from identification.figures.chart_style import Chart
    from youbot_scripts.shared.report_page import Part


def in_words(row: Speed) -> str:
    """A case in a few words, as a chart's row names it."""
    if row.copies == 1 and row.bytes_a_copy is None:
        return row.case
    more = ["float32"] if row.case.endswith("float32") else []
    more += [f"{row.threads} threads"] if row.threads > 1 else []
    more += [f"{row.effects} effect{'s' if row.effects > 1 else ''}"] if row.effects else []
    return ", ".join([f"{row.copies} at once", *more])


def write_report(
    path: Path, found: Sequence[Speed], tables: Sequence[Table], machine: Mapping[str, Any]
) -> None:
    """Write the page of a benchmark; ``found``: speeds, where they were measured.

    Raises
    ------
    InputError
        If the file cannot be written, or a library of the extra `plots` is missing.
    """
    from youbot_scripts.shared.report_page import write_page

    write_page(path, "Speed beside peers", _parts(found, tables, machine), None)


def _parts(
    found: Sequence[Speed], tables: Sequence[Table], machine: Mapping[str, Any]
) -> Iterator[Part]:
    from youbot_scripts.shared.report_page import Charts, Words

    if found:
        fastest, one = max(found, key=lambda row: row.rate), found[0]
        yield Words(
            [
                f"One environment: {one.rate / 1e3:.3g} thousand steps a second, {one.ratio:.2f} "
                f"times as fast as CartPole-v1; most: {fastest.rate / 1e6:.3g} million a second "
                f"({in_words(fastest)})"
            ],
            "verdict",
        )
    load = "" if not machine.get("load") else f", load {machine['load'][0]:.1f}"
    yield Words([f"{machine['processor']}, {machine['cores']} cores{load}"])
    if found:
        yield Charts([rates_chart(found)])
        yield Charts([ratios_chart(found)])
    yield from tables


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
        ("the peer", 0.15, look.BAR, [row.peer_rate for row in found]),
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
    figure.update_xaxes(title_text="times as fast as the peer", rangemode="tozero")
    title = "Times as fast as the peer, in turns"
    return Chart("ratios", title, figure, height)
