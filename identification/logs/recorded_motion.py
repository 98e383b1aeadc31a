"""The reference motion of a log, if the record of `youbot record` beside it names one."""

from __future__ import annotations

from pathlib import Path

from identification.logs.log import Log
from youbot_env.files import FileKind, read_json
from youbot_env.motions.base import Motion, motion_from_dict

RECORD = "record.json"
"""File beside the logs in which `youbot record` says how they were made."""

RECORD_FILE = FileKind(
    "a record of `youbot record`",
    {
        "type": "object",
        "properties": {
            "logs": {
                "type": "object",
                "additionalProperties": {"type": "object", "required": ["sha256"]},
            },
            "motions": {"type": "array", "items": {"type": "object", "required": ["name"]}},
        },
        "required": ["logs", "motions"],
    },
    lambda content, source: content,
    version=None,
)


def recorded_motion(log: Log) -> Motion | None:
    """The reference of a log as a function of its ``time``, or None where it is not known.

    It is known if a record.json beside the log lists the log with the same hash of its bytes.
    """
    source = Path(log.source)
    # A log made in memory has no name. A pipe beside a log is not for us to read.
    if not source.name or not source.with_name(RECORD).is_file():
        return None
    try:
        record = read_json(source.with_name(RECORD), RECORD_FILE)
        known = record["logs"].get(source.name)
        if known is None or known["sha256"] != log.sha256:
            return None
        motions = [motion for motion in record["motions"] if motion["name"] == log.name]
        return motion_from_dict(motions[0]) if len(motions) == 1 else None
    except (ValueError, TypeError):
        # A file of another program: no reference is known.
        return None
