"""What the engine knows of a mechanism, and the mechanisms that there are."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
