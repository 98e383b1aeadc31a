from .c_code import to_c as to_c
from .control_systems import linear_control as linear_control, to_control as to_control
from .mujoco_bodies import to_mjcf as to_mjcf
from .step_function import step_function as step_function
from .torch_export import to_torch as to_torch
