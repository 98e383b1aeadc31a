"""The motion that a log was asked to follow, where `youbot record` left word of it."""

from __future__ import annotations

import json
from pathlib import Path

from identification.logs.log import Log
from youbot_env.errors import InputError
from youbot_env.motions.base import Motion, motion_from_dict

RECORD = "record.json"
"""File beside the logs in which `youbot record` says how they were made."""


def recorded_motion(log: Log) -> Motion | None:
    """The reference of a log as a function of its ``time``, or None where it is not known.

    It is known when a record.json beside the log lists the very bytes of the log.
    """
    try:
        record = json.loads(Path(log.source).with_name(RECORD).read_text("utf-8"))
        if record["logs"][Path(log.source).name]["sha256"] != log.sha256:
            return None
        (motion,) = [m for m in record["motions"] if m["name"] == log.name]
        return motion_from_dict(motion)
    except (OSError, ValueError, LookupError, TypeError, InputError, RecursionError):
        return None  # another program's record.json, or none: nothing is known
