"""Foreign recordings (bags, MCAP, text files, Parquet) made into logs, by a map."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
