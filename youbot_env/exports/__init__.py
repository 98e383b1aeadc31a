"""A model in other people's tools: python-control, torch, MuJoCo, and a plain function of arrays.

Nothing here knows an equation of motion: each form is derived from the physics."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
