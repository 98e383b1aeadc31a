"""Laws beyond the catalogue: a grammar of effects, its search, and the evidence."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
