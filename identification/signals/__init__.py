"""Filters, resampling and noise of sampled signals; nothing here knows a robot."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
