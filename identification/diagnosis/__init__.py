"""Which physical effect a model lacks: candidates, search, verdict, next experiment."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
