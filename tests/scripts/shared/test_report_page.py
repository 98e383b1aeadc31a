"""A report is one file that shows what it was given, runs nothing and fetches nothing."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest

from youbot_scripts.cli import command_line
from youbot_scripts.shared.report_page import Words, page, unbroken
from youbot_scripts.shared.tables import Table, columns, text as text_column

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
        self.texts.append(data)


def everywhere(text: str) -> str:
    """A page on which a text stands in every place that takes one."""
    table = Table(text, columns(text, text_column("b")), ((text, 1),), (text,), text)
    parts = [Words([text], "verdict", text), table]
    return page(text, parts, {text: text}, command=text)


def test_names_are_text_wherever_they_stand():
    found, plain = Reader(everywhere(EVIL)), Reader(everywhere("name"))
    assert found.tags == plain.tags and "script" not in found.tags
    assert found.sources == plain.sources == []
    assert "".join(found.texts).count(EVIL) == "".join(plain.texts).count("name") >= 9


def test_parts_come_in_order_and_tables_are_whole():
    headers = columns("name", "value", text_column("unit"))
    table = Table("T", headers, (("a", 1.5, "m"), ("b", "-", "s")))
    text = page("P", [Words(["first"]), table, Words(["last"])], {"seed": 7})
    cells = re.findall(r"<td(?: class=\"text\")?>([^<]*)</td>", text)
    assert cells == ["a", "1.5", "m", "b", "-", "s"]
    assert text.index("first") < text.index("<table>") < text.index("last")
    assert '<td class="text">m</td>' in text and "seed 7" in text


def test_a_table_without_rows_is_its_notes():
    text = page("P", [Table("T", columns("a", "b"), (), ("nothing to tell",))], {})
    assert "nothing to tell" in text and "<table>" not in text


def test_a_number_and_its_sign_stand_on_one_line():
    told = unbroken("falls from 15.5 % to 1 % (95 %), 4.0 ± 0.2 N; % alone, a % b")
    assert told.count("\u00a0") == 5
    assert told.replace("\u00a0", " ").startswith("falls from 15.5 % to 1 % (95 %), 4.0 ± 0.2 N")
    assert "15.5\u00a0%" in page("P", [Words(["15.5 %"])], {}) and "a % b" in told


def test_outside_a_command_the_process_s_own_line_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["x", "identify", "a b.csv"])
    assert command_line() == "youbot identify 'a b.csv'"
