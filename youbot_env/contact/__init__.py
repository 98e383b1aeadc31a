"""A plant with real rollers on a floor, simulated by MuJoCo."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
