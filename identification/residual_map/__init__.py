"""Which variables predict what a model misses, on stretches that it has not seen."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
