from .pid import PID as PID
