"""Model, simulation and Gymnasium environments of a mecanum platform.

What is public is listed in ``__init__.pyi`` and imported when it is first used: a model needs no
compiler, a script no Gymnasium.
"""

from lazy_loader import attach_stub

from youbot_env.tracking.registration import register_when_imported

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

register_when_imported()
