"""Tables: what a terminal shows of them, and formats of numbers."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from youbot_scripts.shared.options import console
from youbot_scripts.shared.tables import (
    Column,
    Table,
    columns,
    folded,
    percent,
    show,
    text,
    with_std,
)


def test_a_table_fits_in_80_columns_and_loses_no_text():
    out = io.StringIO()
    sentence = "The residual is a constant force in the world: turned around, its sign flips."
    rows = (("floor_tilt", 1.5, sentence), ("tether", 22.25, "[red]no markup[/red] [N/m]"))
    console = Console(file=out, width=80)
    headers = columns("effect", "size [rad]", text("sign"))
    show(console, [Table("Effects", headers, rows)])
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "[red]no markup[/red] [N/m]" in out.getvalue()
    assert "size [rad]" in out.getvalue()
    for word in sentence.split():
        assert word in out.getvalue()
    first, second = (next(line for line in lines if key in line) for key in ("1.5", "22.25"))
    assert first.index("1.5") + 3 == second.index("22.25") + 5, "numbers are flush right"


LONG = "viscous_roller_friction_changing_over_the_floor_x"


@pytest.mark.parametrize("name", [LONG, "dry_wheel_friction_beyond_an_edge_in_x", "tether"])
@pytest.mark.parametrize("width", [80, 100])
def test_long_names_break_between_their_words_and_figures_stay_whole(name: str, width: int):
    out = io.StringIO()
    sizes = "torque 0.25, edge 0.1, phase_fl 0.2, phase_fr 0.2, phase_bl 0.2, phase_br 0.2"
    table = Table(
        f"with {name}, whose title is longer than the table and stays on one line all the same",
        columns("effect", "force error", "p", text("sizes")),
        ((name, "15.00 %", "0.001", sizes), (f"{name}.torque", "1.50 %", "0.02", "torque 0.1")),
    )
    show(Console(file=out, width=width), [table])
    title, *lines = out.getvalue().splitlines()
    assert title == table.title and max(map(len, lines)) <= width
    shown = "".join(line[: lines[1].index("force error")].strip() for line in lines)
    assert f"{name}{name}.torque" in shown, "no letter is lost"
    words = {*name.split("_"), "torque"}
    for line in lines[3:]:
        for word in filter(None, line[: lines[1].index("force error")].strip().split("_")):
            assert {*word.strip(".").split(".")} <= words, f"{word} is no word of the name"
    for figure in ("15.00 %", "0.001", "0.25", "0.2,"):
        assert any(figure in line for line in lines)


def test_what_fits_is_not_folded():
    assert folded("a_long_name", None) == "a_long_name"
    assert folded("a_long_name", 11) == "a_long_name"
    assert folded("a_long_name", 8) == "a_long_\nname"
    assert folded("0.123 and 0.456", 10) == "0.123 and\n0.456"
    assert folded("nowhere", 3) == "nowhere"


@pytest.mark.parametrize("width", range(20, 45))
def test_no_line_begins_with_a_per_cent_sign(width: int, monkeypatch: pytest.MonkeyPatch):
    out, sentence = io.StringIO(), "base parameters within their 95 % intervals, 12.5 % of all"
    printing = console()
    monkeypatch.setattr(printing, "file", out)
    printing.width = width
    printing.print(sentence)
    show(printing, [Table("T", columns("a", "b"), ((sentence, "1"),))])
    lines = [line.strip() for line in out.getvalue().splitlines()]
    assert max(map(len, lines)) <= width
    assert not [line for line in lines if line.startswith("%")]
    assert " ".join(lines).startswith(sentence)


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (35.3123, 0.2149, "35.31 ± 0.21"),
        (0.0057312, 0.000123, "0.00573 ± 0.00012"),
        (1234.5, 120.0, "1234 ± 120"),
        (1.0, 0.0, "1"),
        (1.0, float("nan"), "1"),
        (float("nan"), 1.0, "-"),
    ],
)
def test_an_estimate_is_rounded_to_its_uncertainty(value, std, shown):
    assert with_std(value, std) == shown


def test_a_column_shows_values_in_its_format_and_text_as_it_is():
    shown = columns("log", Column("error", percent))
    table = Table("Errors", shown, (("a", 0.0123), ("total", ""), ("b", float("nan"))))
    assert table.headers == ("log", "error")
    assert table.cells == (("a", "1.23 %"), ("total", ""), ("b", "-"))
