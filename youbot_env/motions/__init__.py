"""Reference motions of the platform: calibration, multisines, steps, and what they may ask for."""

import importlib

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

# A file names a motion by its kind, and a kind is known once its module is imported: whoever can
# read one motion must know them all.
for _name in ("calibration", "multisine", "periodic", "steps"):
    importlib.import_module(f"{__name__}.{_name}")
