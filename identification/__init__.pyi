from .comparison import (
    Comparison as Comparison,
    ComparisonSettings as ComparisonSettings,
    compare as compare,
)
from .diagnosis import (
    Addition as Addition,
    Diagnosis as Diagnosis,
    DiagnosisSettings as DiagnosisSettings,
    add_effect as add_effect,
    diagnose as diagnose,
)
from .doctor import LogExamination as LogExamination, examine_log as examine_log
from .fitting import (
    FitSettings as FitSettings,
    Identification as Identification,
    Observability as Observability,
    RecursiveLeastSquares as RecursiveLeastSquares,
    identify as identify,
    motion_observability as motion_observability,
)
from .logs import (
    Log as Log,
    LogSettings as LogSettings,
    read_log as read_log,
    read_logs as read_logs,
    write_log as write_log,
)
from .mechanisms import MechanismSettings as MechanismSettings
