"""A report is one file that shows what it was given, runs nothing and fetches nothing."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from identification.fitting.misfit import stated_estimates
from youbot_env.equations import formula
from youbot_env.model.model_file import load_model
from youbot_env.physics.effect import CATALOGUE
from youbot_scripts.cli import command_line
from youbot_scripts.shared import result_tables
from youbot_scripts.shared.report_page import Words, coded, page, terms_of, unbroken
from youbot_scripts.shared.tables import Column, Table, columns, text as text_column, unit

EVIL = '<script>alert(1)</script> & "x" <img src=http://evil>'


class Reader(HTMLParser):
    """Tags and texts of a page, as a browser would see them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.sources: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] != ["script"]:
            self.texts.append(data)


def everywhere(text: str) -> str:
    """A page on which a text stands in every place that takes one."""
    table = Table(text, columns(text, text_column("b")), ((text, 1),), (text,), text)
    parts = [Words([text], "verdict", text), table]
    return page(text, parts, {text: text}, command=text)


def test_names_are_text_wherever_they_stand():
    found, plain = Reader(everywhere(EVIL)), Reader(everywhere("name"))
    assert found.tags == plain.tags
    assert found.tags.count("script") == 1, "the page's own, of its tables"
    assert found.sources == plain.sources == []
    assert "".join(found.texts).count(EVIL) == "".join(plain.texts).count("name") >= 9


def test_parts_come_in_order_and_tables_are_whole():
    headers = columns("name", "value", text_column("unit"))
    table = Table("T", headers, (("a", 1.5, "m"), ("b", "-", "s")))
    text = page("P", [Words(["first"]), table, Words(["last"])], {"seed": 7})
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", text)
    assert cells == ["a", "1.5", "m", "b", "-", "s"]
    assert text.index("first") < text.index("<table>") < text.index("last")
    assert '<td class="text" data-label="unit">m</td>' in text and "seed 7" in text


def test_units_and_parameters_are_typeset_and_names_are_not():
    rows = (("m0 + 4 I1/R^2", "x^2", "kg m^2"), ("mu1", "m1", "N m"))
    table = Table("phi_1' + phi_2'", (unit("name"), Column("log"), unit()), rows)
    text = page("P", [table], {})
    assert "m<sub>0</sub> + 4 I<sub>1</sub>/R<sup>2</sup>" in text and ">x^2<" in text
    assert "kg m<sup>2</sup>" in text and "µ<sub>1</sub>" in text and ">m1<" in text
    assert "φ<sub>1</sub>′ + φ<sub>2</sub>′" in text


def test_what_stands_between_backticks_is_code_and_nothing_else_becomes_markup():
    assert coded("`youbot diagnose` names <it>") == "<code>youbot diagnose</code> names &lt;it&gt;"
    assert coded("`<b>` and a` b") == "`&lt;b&gt;` and a` b"


def test_a_formula_breaks_between_its_terms_and_nowhere_else():
    latex = r"\left(a + \frac{b - c}{d}\right) \, x - e^{- y} = F"
    assert [term.strip() for term in terms_of(latex)] == [
        r"\left(a + \frac{b - c}{d}\right) \, x", "{} - e^{- y}", "{} = F"
    ]  # fmt: skip
    for item in CATALOGUE:
        whole = formula(item, "latex")
        assert "".join(terms_of(whole)).replace("{} ", "") == whole.replace("{} ", ""), item.name


def test_a_table_without_rows_is_its_notes():
    text = page("P", [Table("T", columns("a", "b"), (), ("nothing to tell",))], {})
    assert "nothing to tell" in text and "<table>" not in text


def test_a_number_and_its_sign_stand_on_one_line():
    told = unbroken("falls from 15.5 % to 1 % (95 %), 4.0 ± 0.2 N; % alone, a % b")
    assert told.count("\u00a0") == 5
    assert told.replace("\u00a0", " ").startswith("falls from 15.5 % to 1 % (95 %), 4.0 ± 0.2 N")
    assert unbroken("25.56% to 1.20%, 5%x") == "25.56\u00a0% to 1.20\u00a0%, 5%x"
    assert "15.5\u00a0%" in page("P", [Words(["15.5 %"])], {}) and "a % b" in told


def test_outside_a_command_the_process_s_own_line_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["x", "identify", "a b.csv"])
    assert command_line() == "youbot identify 'a b.csv'"


def test_no_interval_is_stated_of_a_model_that_does_not_fit():
    """Whatever errors the model holds of its own: `add` judges by those held out."""
    paper = load_model("paper")
    known = {name: replace(entry, std=0.1) for name, entry in paper.parameters.items()}
    model = replace(paper, parameters=known)
    for fits in (True, False):
        found = stated_estimates(model, fits=fits)
        rows = found.values()
        assert all((row["interval"] is not None) == fits for row in rows)
        shown = result_tables.parameters(found).cells
        assert all((cells[2] != "-") == fits and ("±" in cells[1]) == fits for cells in shown)
