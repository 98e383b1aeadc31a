"""Which reader a source needs, by its content: a bag, an MCAP file, Parquet or text."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from identification.importing.bags import read_bag, read_mcap
from identification.importing.clock_columns import add_clocks
from identification.importing.joint_names import name_joints
from identification.importing.messages import read_json_table
from identification.importing.settings import ImportSettings
from identification.importing.tables import Table
from identification.importing.text_tables import (
    is_parquet,
    read_parquet_table,
    read_text_table,
)
from identification.logs.findings import fault
from identification.logs.formats import read_bytes

ROS1_MAGIC, ROS1_OLD_MAGIC = b"#ROSBAG V2.0", b"#ROS"
SQLITE_MAGIC, MCAP_MAGIC = b"SQLite format 3\x00", b"\x89MCAP"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
BAG_ENDINGS = (".db3", ".mcap", ".bag")


def read_source(
    path: str | os.PathLike[str], settings: ImportSettings = ImportSettings()
) -> list[Table]:
    """The tables of a source: topics of a bag or an MCAP file, or the one table of a text file.

    Raises
    ------
    InputError
        If it cannot be read: one line that says why and what cures it.
    """
    path = Path(path)
    source = str(path)
    if path.is_dir():
        return _read_folder(path, settings)
    size = _size(path)
    if size > settings.max_bytes and not _starts(path, ROS1_MAGIC, SQLITE_MAGIC, MCAP_MAGIC):
        cure = "cut it into pieces"
        raise fault(source, f"is larger than {settings.max_bytes >> 20} MB", cure)
    if _starts(path, ROS1_MAGIC, SQLITE_MAGIC):
        return read_bag([path], settings)
    if _starts(path, MCAP_MAGIC):
        return read_mcap(path, settings)
    if _starts(path, ROS1_OLD_MAGIC) and path.suffix == ".bag":
        raise fault(source, "is a bag of an old format", "rosbag fix it, or record it again")
    if _starts(path, ZSTD_MAGIC):
        raise fault(source, "is compressed by zstd as a whole", f"zstd -d {path}")
    if path.name.lower().endswith(BAG_ENDINGS) and size:
        cure = "copy or record it again (rosbag reindex, ros2 bag reindex or mcap recover may help)"
        raise fault(source, f"does not begin as a {path.suffix} file does", cure)
    content = read_bytes(path)
    if is_parquet(path, content):
        table = read_parquet_table(source, content)
    elif content.lstrip()[:1] in (b"{", b"["):
        table = read_json_table(source, content, settings)
    else:
        table = read_text_table(source, content)
    table.drop_absurd(settings.max_number)
    name_joints(table, settings)
    if not table.clocks:
        add_clocks(table, settings)
    return [table]


def read_sources(
    paths: Sequence[str | os.PathLike[str]], settings: ImportSettings = ImportSettings()
) -> list[Table]:
    """The tables of several sources of one run; those of text files go by the files' stems."""
    found = [read_source(path, settings) for path in paths]
    tables = [table for tables in found for table in tables]
    if len(found) > 1:
        for table in tables:
            table.topic = table.topic or Path(table.source).name.split(".")[0]
    return tables


def _read_folder(path: Path, settings: ImportSettings) -> list[Table]:
    if (path / "metadata.yaml").is_file():
        return read_bag([path], settings)
    inside = sorted(p for p in path.iterdir() if p.name.lower().endswith(BAG_ENDINGS))
    if not inside:
        cure = f"name the files in it: {path}/*.csv"
        raise fault(str(path), "is a folder without a bag in it", cure)
    # A recorder that was killed leaves the pieces of a bag without their metadata.
    return [table for piece in inside for table in read_source(piece, settings)]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        raise fault(str(path), "no such file", "check the path") from None


def _starts(path: Path, *magic: bytes) -> bool:
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except PermissionError:
        raise fault(str(path), "no permission to read it", f"chmod +r {path}") from None
    return start.startswith(magic)
