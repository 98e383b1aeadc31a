from .kinematics import Kinematics as Kinematics, estimate_kinematics as estimate_kinematics
from .motion import Motion as Motion
from .settings import KinematicsSettings as KinematicsSettings
