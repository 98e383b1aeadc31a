from .findings import Finding as Finding, LogError as LogError
from .log import AXIS as AXIS, Log as Log
from .reading import read_log as read_log, read_logs as read_logs, write_log as write_log
from .settings import LogSettings as LogSettings
