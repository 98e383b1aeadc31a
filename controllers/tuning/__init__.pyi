from .controller_tuning import (
    TunedController as TunedController,
    TuningTask as TuningTask,
    tune_kinematic as tune_kinematic,
    tune_pid as tune_pid,
)
from .tuning import Tuning as Tuning
