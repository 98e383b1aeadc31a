"""Tables: what a terminal shows of them, and formats of numbers."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from youbot_scripts.shared.options import console
from youbot_scripts.shared.tables import Column, Table, columns, percent, show, text, with_std


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
