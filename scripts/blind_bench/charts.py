"""The page of a bench and its charts: rates by kind, calibration of intervals, sizes, confusion."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import norm

from identification.figures import chart_style as look
from identification.figures.chart_style import Chart
from identification.figures.interval_charts import Spread, add_spreads, height_of, name_rows
from youbot_scripts.blind_bench.promises import WANTED
from youbot_scripts.blind_bench.proportions import Proportion
from youbot_scripts.blind_bench.scores import (
    INTERVAL,
    alone,
    answer,
    base_off,
    by_kind,
    named_sets,
    planted,
    right,
    sizes_off,
    wrongly_named,
)
from youbot_scripts.blind_bench.trials import Record, errors_of
from youbot_scripts.shared.report_page import Charts, Part, Words, write_page
from youbot_scripts.shared.tables import Table

LEVELS = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)
"""Nominal shares of stated intervals that are compared with what they hold."""

GOOD, DOUBTFUL, BAD, ODD = "#2aa876", "#d99a00", "#e0691f", "#8f8f8f"

MOST_DEVIATIONS = 5.0
"""Beyond it, marks stand at the edge of their chart."""


def charts_of(records: Sequence[Record]) -> Iterator[Chart]:
    """All charts; those about which no record says anything are left out."""
    known = [record for record in records if "found" in record]
    if not known:
        return
    yield rates_chart(records)
    yield calibration_chart(known)
    if any(sizes_off(record) for record in known):
        yield sizes_chart(known)
    single = [record for record in records if len(planted(record)) < 2]
    if single:
        yield answers_chart(single)
        yield confusion_chart(single)


def rates_chart(records: Sequence[Record]) -> Chart:
    """Shares of each kind that are right, and that name what nobody planted; Wilson's intervals."""
    groups = by_kind(records)
    height = height_of(len(groups), 2)
    titles = ("right [%]", "named what nobody planted [%]")
    figure = look.rows_figure(2, height, titles, shared=False)
    checks: tuple[tuple[str, Callable[[Record], bool], str], ...] = (
        ("right", right, GOOD),
        ("wrongly_named", wrongly_named, BAD),
    )
    for row, (key, check, colour) in enumerate(checks, start=1):
        shares = {kind: Proportion.of(map(check, rows)) for kind, rows in groups.items()}
        spreads = [_spread(kind, share) for kind, share in shares.items()]
        add_spreads(figure, row, spreads, "measured", {"color": colour}, legend=False)
        goals = [(k, _goal(kind, key)) for k, kind in enumerate(groups)]
        figure.add_trace(
            look.plotly().Scatter(
                x=[goal for _, goal in goals if goal is not None],
                y=[k for k, goal in goals if goal is not None],
                mode="markers", name="wanted", legendgroup="wanted", showlegend=row == 1,
                marker={"symbol": "line-ns-open", "size": 16, "color": ODD, "line": {"width": 2}},
                hovertemplate="wanted: %{x:g} %<extra></extra>",
            ),
            row=row, col=1,
        )  # fmt: skip
        name_rows(figure, row, [f"{kind} ({share.total})" for kind, share in shares.items()])
        figure.update_xaxes(range=[-2, 102], matches=None, showticklabels=True, row=row, col=1)
    return Chart("rates", "Rates by kind of case, with Wilson's 95 % intervals", figure, height)


def _spread(name: str, share: Proportion) -> Spread:
    low, high = share.wilson()
    told = (
        f"{look.safe(name)}: {share.count} of {share.total}, {100 * share.value:.1f} %"
        f"<br>95 %: {100 * low:.1f} to {100 * high:.1f} %"
    )
    return Spread(name, 100 * share.value, 100 * low, 100 * high, told)


def _goal(kind: str, key: str) -> float | None:
    """The number of a target such as ">= 97 %"; None where there is none in per cent."""
    found = re.search(r"([\d.]+) %", WANTED.get((kind, key), ""))
    return float(found[1]) if found else None


def calibration_chart(records: Sequence[Record]) -> Chart:
    """Share of the true numbers inside stated intervals, over the share that was promised."""
    offs = {
        "sizes of effects": [off for record in records for off in sizes_off(record)],
        "base parameters": [
            off for record in records for off in base_off(record).values() if off is not None
        ],
    }
    height = 420
    figure = look.finished(look.plotly().Figure(), height)
    ends = {"x": [50, 100], "y": [50, 100], "mode": "lines", "hoverinfo": "skip"}
    figure.add_trace(
        look.plotly().Scatter(
            **ends, name="as promised", line={"color": ODD, "dash": "dash", "width": 1}
        )
    )
    for k, (name, found) in enumerate((n, f) for n, f in offs.items() if f):
        shares = [_inside(found, level) for level in LEVELS]
        spreads = [
            _spread(f"{level:.0%}", share) for level, share in zip(LEVELS, shares, strict=True)
        ]
        figure.add_trace(
            look.plotly().Scatter(
                x=[100 * level + 0.3 * k for level in LEVELS],
                y=[spread.value for spread in spreads],
                error_y={
                    "type": "data", "symmetric": False, "width": 3, "thickness": 1.3,
                    "array": [(s.high or s.value) - s.value for s in spreads],
                    "arrayminus": [s.value - (s.low or 0.0) for s in spreads],
                },
                text=[spread.told for spread in spreads], mode="lines+markers",
                name=f"{name} ({len(found)})", line={"color": look.AXES[k], "width": 1.5},
                hovertemplate="promised %{text}<extra></extra>",
            )
        )  # fmt: skip
    figure.update_xaxes(title_text="promised [%]", range=[48, 101])
    figure.update_yaxes(title_text="inside the interval [%]")
    title = "Calibration: how often stated intervals hold the truth"
    return Chart("calibration", title, figure, height)


def _inside(offs: Sequence[float], level: float) -> Proportion:
    reach = float(norm.ppf(0.5 + level / 2))
    return Proportion.of(off <= reach for off in offs)


def sizes_chart(records: Sequence[Record]) -> Chart:
    """Each stated size less the planted one, in stated standard deviations, by parameter."""
    found = [spread for record in records for spread in _deviations(record)]
    names = sorted({spread.name for spread in found})
    height = height_of(len(names))
    figure = look.rows_figure(1, height)
    figure.add_vrect(
        x0=-INTERVAL, x1=INTERVAL, fillcolor=look.FLOOR_FILL, line_width=0, layer="below"
    )
    of, counts = Counter(spread.name for spread in found), Counter[str]()
    for name, colour in (("inside the 95 % interval", GOOD), ("outside", BAD)):
        chosen = [s for s in found if (abs(s.value) <= INTERVAL) == (colour == GOOD)]
        places = []
        for spread in chosen:
            counts[spread.name] += 1
            # Several numbers of one row stand below each other.
            beside = 0.7 * (counts[spread.name] / (of[spread.name] + 1) - 0.5)
            places.append(names.index(spread.name) + beside)
        figure.add_trace(
            look.plotly().Scatter(
                x=[min(max(s.value, -MOST_DEVIATIONS), MOST_DEVIATIONS) for s in chosen], y=places,
                text=[s.told for s in chosen], mode="markers", name=name,
                marker={"color": colour, "size": 7}, hovertemplate="%{text}<extra></extra>",
            )
        )  # fmt: skip
    name_rows(figure, 1, names)
    edge = MOST_DEVIATIONS + 0.3
    figure.update_xaxes(title_text="deviation [std]", range=[-edge, edge], zeroline=True)
    title = "Sizes of effects: how far off, in stated standard deviations"
    return Chart("sizes", title, figure, height)


def _deviations(record: Record) -> Iterator[Spread]:
    stated = record.get("sizes", {})
    for item in record["case"]["planted"]:
        for key, truth in item["values"].items():
            entry = stated.get(f"{item['name']}.{key}")
            if entry is None or not entry["std"]:
                continue
            name = f"{item['name']}.{key}"
            told = (
                f"{look.safe(name)}, {look.safe(record['case']['key'])}<br>"
                f"planted {truth:.4g}, stated {entry['value']:.4g} ± {entry['std']:.2g}"
            )
            yield Spread(name, (entry["value"] - truth) / entry["std"], told=told)


ANSWERS = {
    "named, alone": GOOD,
    "named, in a set of at most three": "#7fd1ae",
    "right otherwise": "#3d8fd1",
    "unknown": DOUBTFUL,
    "nothing found": ODD,
    "another name": BAD,
    "error": "#a6761d",
}
"""What may be answered where one effect or none is planted, with its colour."""


def answer_kind(record: Record) -> str:
    """Which of `ANSWERS` a record holds."""
    said = answer(record)
    if said == "error":
        return said
    if right(record):
        if named_sets(record) and planted(record) and said != "unknown":
            return "named, alone" if alone(record) else "named, in a set of at most three"
        return "right otherwise"
    return {"unknown": said, "adequate": "nothing found"}.get(said, "another name")


def answers_chart(records: Sequence[Record]) -> Chart:
    """Stacked bars: the share of each answer, by what was planted."""
    counts: dict[str, Counter[str]] = {}
    for record in records:
        counts.setdefault(_truth(record), Counter())[answer_kind(record)] += 1
    names = _in_order(counts)
    height = height_of(len(names))
    figure = look.rows_figure(1, height)
    for kind, colour in ANSWERS.items():
        if any(counts[name][kind] for name in names):
            figure.add_trace(
                look.plotly().Bar(
                    y=list(range(len(names))),
                    x=[100 * counts[name][kind] / counts[name].total() for name in names],
                    text=[f"{name}: {counts[name][kind]}" for name in names],
                    orientation="h", name=kind, marker_color=colour,
                    textposition="none",
                    hovertemplate="%{text} %{fullData.name}<extra></extra>",
                )
            )  # fmt: skip
    figure.update_layout(barmode="stack", legend_traceorder="normal")
    name_rows(figure, 1, [f"{name} ({counts[name].total()})" for name in names])
    figure.update_xaxes(title_text="share of the cases [%]", row=1, col=1)
    return Chart("answers", "What was planted, and what was answered", figure, height)


def confusion_chart(records: Sequence[Record]) -> Chart:
    """Planted against told first: the number of cases, coloured by the share that is right."""
    cells: dict[tuple[str, str], list[bool]] = {}
    for record in records:
        cells.setdefault((_truth(record), answer(record)), []).append(right(record))
    rows = _in_order({truth for truth, _ in cells})
    told = {said for _, said in cells}
    columns = [*[name for name in rows if name in told], *sorted(told - set(rows))]
    filled = [[cells.get((truth, said)) for said in columns] for truth in rows]
    height = 300 + 20 * len(rows)
    figure = look.finished(look.plotly().Figure(), height)
    figure.add_trace(
        look.plotly().Heatmap(
            x=[look.safe(name) for name in columns], y=[look.safe(name) for name in rows],
            z=[[100 * sum(cell) / len(cell) if cell else None for cell in row] for row in filled],
            text=[[str(len(cell)) if cell else "" for cell in row] for row in filled],
            texttemplate="%{text}", zmin=0, zmax=100, xgap=1, ygap=1,
            colorscale=[[0, BAD], [0.5, DOUBTFUL], [1, GOOD]],
            colorbar={
                "title": {"text": "right [%]", "side": "right"}, "orientation": "h",
                "thickness": 10, "len": 0.7, "y": 1.0, "yanchor": "bottom",
            },
            hovertemplate="planted %{y}<br>told %{x}: %{text} cases<extra></extra>",
        )
    )  # fmt: skip
    figure.update_yaxes(autorange="reversed", title_text="planted", zeroline=False, dtick=1)
    figure.update_xaxes(tickangle=-90, title_text="told first", dtick=1, tickfont_size=11)
    return Chart("confusion", "Confusion of names: planted against told", figure, height)


def _truth(record: Record) -> str:
    names = planted(record)
    return names[0] if names else "nothing"


def _in_order(names: Mapping[str, Any] | set[str]) -> list[str]:
    return sorted(names, key=lambda name: (name != "nothing", name))


# --- the page --------------------------------------------------------------------------------


def headline(records: Sequence[Record]) -> str:
    """The bench in a sentence."""
    kinds = dict.fromkeys(record["case"]["kind"] for record in records)
    told = []
    for kind in kinds:
        rows = [record for record in records if record["case"]["kind"] == kind]
        told.append(f"{kind} {sum(map(right, rows))} of {len(rows)}")
    wrong = sum(map(wrongly_named, records))
    return f"Right: {', '.join(told)}; named what nobody planted: {wrong} of {len(records)}"


def write_report(
    path: Path, records: Sequence[Record], tables: Iterable[Table], wrong: Sequence[str], seed: int
) -> None:
    """Write the bench's page.

    Parameters
    ----------
    tables, wrong : of the scores, and a line for each case whose verdict is wrong: see ``report``

    Raises
    ------
    InputError
        If the file cannot be written, or a library of the extra `plots` is missing.
    """
    write_page(path, f"Blind bench: {len(records)} cases", _parts(records, tables, wrong), seed)


def _parts(
    records: Sequence[Record], tables: Iterable[Table], wrong: Sequence[str]
) -> Iterator[Part]:
    yield Words([headline(records)], "verdict")
    yield Words(list(errors_of(records)), "warning")
    for chart in charts_of(records):
        yield Charts([chart])
        if chart.name == "rates":
            note = "In the tables intervals are exact ones (Clopper and Pearson), a little wider."
            yield Words([note])
    yield Words(wrong, heading="Not right" if wrong else "")
    yield from tables
