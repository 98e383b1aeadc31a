from .computed_torque import (
    AdaptiveComputedTorque as AdaptiveComputedTorque,
    ComputedTorque as ComputedTorque,
)
from .interface import (
    Controller as Controller,
    Loop as Loop,
    Observation as Observation,
    Reference as Reference,
)
from .kinematic import KinematicControl as KinematicControl
from .loop import Trace as Trace, closed_loop as closed_loop
from .lqi import LQI as LQI
from .pid import PID as PID
from .policy import Policy as Policy
from .recording import record as record
from .registry import CONTROLLERS as CONTROLLERS, build as build, build_policy as build_policy
from .tuning import (
    TunedController as TunedController,
    TuningTask as TuningTask,
    tune_kinematic as tune_kinematic,
    tune_pid as tune_pid,
)
