from .linear_system import LinearSystem as LinearSystem
from .margins import Margins as Margins
