from .add_effect import Addition as Addition, add_effect as add_effect
from .diagnose import diagnose as diagnose
from .report import Diagnosis as Diagnosis
from .settings import DiagnosisSettings as DiagnosisSettings
