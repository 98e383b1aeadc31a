from .lqi import LQI as LQI
