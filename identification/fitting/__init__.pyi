from .ideal_motions import motion_observability as motion_observability
from .identify import Identification as Identification, identify as identify
from .observability import Observability as Observability
from .recursive import RecursiveLeastSquares as RecursiveLeastSquares
from .settings import FitSettings as FitSettings
