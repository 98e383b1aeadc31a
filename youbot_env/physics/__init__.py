"""Inverse dynamics, the only place that states the physics, and the effects that it is made of."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
