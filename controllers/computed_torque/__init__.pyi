from .adaptive import AdaptiveComputedTorque as AdaptiveComputedTorque
from .computed_torque import ComputedTorque as ComputedTorque
