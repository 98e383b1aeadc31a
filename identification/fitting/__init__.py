"""Regression, covariance, observability, and the identification of a model from logs."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
