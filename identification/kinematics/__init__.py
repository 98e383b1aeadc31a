"""Lengths, delay, frame and slip of a platform from its wheels and a pose or a gyro; no torques."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
