from .add_effect import add_effect as add_effect
from .addition import Addition as Addition
from .diagnose import diagnose as diagnose
from .report import Diagnosis as Diagnosis
from .settings import DiagnosisSettings as DiagnosisSettings
