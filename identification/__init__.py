"""Identify a mecanum platform's dynamics from logs, and compare models with measurements."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
