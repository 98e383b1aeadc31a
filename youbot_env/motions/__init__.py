"""Reference motions of the platform: calibration, multisines, steps, and what they may ask for."""

import importlib

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

# A motion file names the kind of its motion, and a kind is registered when its module is imported.
# So all kinds must be imported before any file is read.
for _name in ("calibration", "multisine", "periodic", "steps"):
    importlib.import_module(f"{__name__}.{_name}")
