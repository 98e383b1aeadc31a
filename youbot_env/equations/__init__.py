"""The equations of motion in print, from the functions that are simulated."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
