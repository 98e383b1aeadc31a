"""The model's inverse dynamics fed forward, with feedback, and the adaptive kind of it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
