"""A model exported to other tools, one file for each; no equation of motion is written here.

``control_systems``: systems of python-control; ``torch_export`` (and ``torch_module``, which
imports torch): a module with gradients; ``mujoco_bodies``: an MJCF document; ``step_function``: a
plain function from a state to the next; ``c_code``: C99 source.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
