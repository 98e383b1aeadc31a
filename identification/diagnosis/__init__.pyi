from .add_effect import Addition as Addition, add_effect as add_effect
from .diagnose import Diagnosis as Diagnosis, diagnose as diagnose
