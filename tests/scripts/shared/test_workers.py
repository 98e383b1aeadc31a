"""Work in other processes."""

from __future__ import annotations

from pathlib import Path

from youbot_scripts.shared.workers import spread


def read(name: str) -> str:
    return Path(name).read_text()


def test_paths_are_meant_from_the_folder_of_the_one_who_asks(tmp_path: Path, monkeypatch) -> None:
    """Workers outlive a command, whose folder need not be that of the one before."""
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        monkeypatch.chdir(tmp_path / folder)
        for name in ("a", "b"):
            Path(name).write_text(f"{name} in {folder}")
        found = dict(spread(read, ["a", "b"], jobs=2))
        assert found == {"a": f"a in {folder}", "b": f"b in {folder}"}
