"""Bags of ROS 1 and ROS 2, and MCAP files: their topics as tables.

rosbags and mcap are imported here alone, and only when such a file is read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from identification.importing.messages import TopicReader, is_bulky
from identification.importing.settings import ImportSettings
from identification.importing.tables import Table
from identification.logs.findings import LogError, fault
from youbot_env.errors import InputError, optional_library

_DAMAGED = "copy or record it again (rosbag reindex, ros2 bag reindex or mcap recover may help)"


def _library(name: str) -> Any:
    return optional_library(name, "import", f"reading bags needs {name.partition('.')[0]}")


def read_bag(paths: Sequence[Path], settings: ImportSettings = ImportSettings()) -> list[Table]:
    """The topics of a ROS 1 bag, of a folder of ROS 2, or of a single .db3 file.

    Raises
    ------
    InputError
        If rosbags is not installed or the bag cannot be read.
    """
    source = str(paths[0])
    highlevel = _library("rosbags.highlevel")
    typesys = _library("rosbags.typesys")
    # Bags of ROS 2 before Iron hold no definitions of their messages: those of a release with the
    # types that such a bag has.
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    readers: dict[str, TopicReader] = {}
    try:
        with highlevel.AnyReader(list(paths), default_typestore=types) as reader:
            wanted = [c for c in reader.connections if not is_bulky(c.msgtype)]
            unread: dict[str, str] = {}
            if not wanted:
                raise fault(source, "holds no topic that import reads", "record joint states")
            for connection, time, raw in reader.messages(connections=wanted):
                topic = connection.topic
                if topic in unread or len(raw) > settings.max_message_bytes:
                    continue
                if topic not in readers:
                    readers[topic] = TopicReader(source, topic, connection.msgtype, settings)
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception as error:  # a type that the bag does not define
                    unread[topic] = _reason(error)
                    continue
                readers[topic].add(time, message)
    except LogError:
        raise
    except Exception as error:  # rosbags raises its own, struct's, sqlite's, yaml's ... kinds
        raise fault(source, f"cannot be read as a bag ({_reason(error)})", _cure(error)) from None
    return _tables(source, readers)


def read_mcap(path: Path, settings: ImportSettings = ImportSettings()) -> list[Table]:
    """The topics of an MCAP file whose messages are JSON, or CDR or ROS 1 with their definitions.

    Raises
    ------
    InputError
        If mcap is not installed, the file is damaged, or no topic has one of these encodings.
    """
    source = str(path)
    module = _library("mcap.reader")
    readers: dict[str, TopicReader] = {}
    unread: dict[str, str] = {}
    decoders: dict[int, Any] = {}
    try:
        with path.open("rb") as file:
            for schema, channel, message in _messages(module, file, settings):
                topic = channel.topic
                if topic in unread or len(message.data) > settings.max_message_bytes:
                    continue
                kind = schema.name if schema else ""
                if is_bulky(kind):
                    continue
                try:
                    if channel.id not in decoders:
                        decoders[channel.id] = _decoder(schema, channel)
                    decoded = decoders[channel.id](message.data)
                except Exception as error:  # the decoders raise many kinds
                    unread[topic] = _reason(error)
                    continue
                if topic not in readers:
                    readers[topic] = TopicReader(source, topic, kind, settings)
                stamp = message.publish_time or message.log_time
                readers[topic].add(stamp, decoded)
    except LogError:
        raise
    except Exception as error:  # mcap raises its own, struct's, zstd's ... kinds
        if not readers:
            message = f"cannot be read as MCAP ({_reason(error)})"
            raise fault(source, message, _cure(error)) from None
        # A recorder that was killed leaves the last chunk unfinished: what came before is whole.
        next(iter(readers.values())).note(f"the file ends in mid-record ({_reason(error)})")
    if not readers and unread:
        topic, reason = next(iter(unread.items()))
        cure = "write it as JSON or with ROS 2's serialisation (CDR)"
        raise fault(source, f"no topic can be decoded, {topic}: {reason}", cure)
    return _tables(source, readers)


def _messages(module: Any, file: Any, settings: ImportSettings) -> Iterator[Any]:
    """Messages of an MCAP file, by its index or, where that is missing, from its start on."""
    bounds = {"validate_crcs": True, "record_size_limit": settings.max_record_bytes}
    try:
        reader = module.SeekingReader(file, **bounds)
        summary = reader.get_summary()
    except Exception:  # a file that was cut has none
        summary = None
    if summary is not None and summary.chunk_indexes:
        yield from reader.iter_messages()
        return
    file.seek(0)
    yield from module.NonSeekingReader(file, **bounds).iter_messages(log_time_order=False)


def _decoder(schema: Any, channel: Any) -> Any:
    """What makes an object of a message's bytes.

    Raises
    ------
    InputError
        If the encoding is none that is read.
    """
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding not in ("cdr", "ros1") or schema is None:
        raise InputError(f"its messages are {encoding or 'of no known encoding'}")
    name, text = schema.name, schema.data.decode("utf-8", errors="replace")
    full = name if name.count("/") == 2 else name.replace("/", "/msg/", 1)
    store = _types(full, text, schema.encoding)
    if encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, full)
    return lambda data: store.deserialize_cdr(data, full)


# Classes of a hundred types are made for each definition, in a tenth of a second: files of one
# robot, and its channels, share their definitions.
@lru_cache(maxsize=8)
def _types(name: str, text: str, encoding: str) -> Any:
    """The types of a message by its definition.

    Raises
    ------
    InputError
        If the definition is in a language that is not read.
    """
    typesys = _library("rosbags.typesys")
    # A constant table of common types (time, header) that a definition may leave out.
    common = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    if not text.strip():
        return common
    if encoding in ("ros2msg", "ros1msg"):
        found = typesys.get_types_from_msg(text, name)
    elif encoding == "ros2idl":
        found = typesys.get_types_from_idl(text)
    else:
        raise InputError(f"its definitions are {encoding}")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register({**common.fielddefs, **found})
    return store


def _cure(error: Exception) -> str:
    if "ompression" in str(error):
        return "decompress it first (rosbag decompress, ros2 bag convert, mcap compress)"
    return _DAMAGED


def _reason(error: Exception) -> str:
    text = str(error).strip().splitlines()
    # Long lists of topics or paths do not help; the first clause does.
    return text[0][:120] if text else type(error).__name__


def _tables(source: str, readers: dict[str, TopicReader]) -> list[Table]:
    tables = [table for reader in readers.values() for table in reader.tables()]
    if not tables:
        raise fault(source, "holds no message with numbers", "record joint states")
    return tables
