from .identify import Identification as Identification, identify as identify
from .observability import (
    Observability as Observability,
    motion_observability as motion_observability,
)
from .recursive import RecursiveLeastSquares as RecursiveLeastSquares
from .settings import FitSettings as FitSettings
