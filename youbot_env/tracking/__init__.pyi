from .env import YouBotTrackingEnv as YouBotTrackingEnv
from .randomisation import Posterior as Posterior, Uniform as Uniform
from .registration import register as register
from .sensors import Sensors as Sensors
from .task import TrackingTask as TrackingTask
