"""The model as a torch module. Torch is imported only when a module is made."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from youbot_env.errors import optional_library
from youbot_env.model.model import Model
from youbot_env.model.model_file import load_model

if TYPE_CHECKING:
    from youbot_env.exports.torch_module import TorchPlatform


def to_torch(
    model: str | os.PathLike[str] | Model,
    *,
    trainable: Iterable[str] | None = None,
    **factory: Any,
) -> TorchPlatform:
    """The model as a ``torch.nn.Module`` whose parameters are the physical ones (extra: rl).

    Parameters
    ----------
    model : a model, a model file, or a shipped model's name
    trainable : full names of the parameters that require gradients (``mu1``,
        ``floor_tilt.tilt_x``); None is all
    factory : ``dtype`` (double precision by default) and ``device`` of the parameters

    Raises
    ------
    InputError
        If torch is missing, the model cannot be read, or a name is unknown.
    """
    optional_library("torch", "rl", "this export needs torch")
    from youbot_env.exports.torch_module import TorchPlatform

    return TorchPlatform(load_model(model), trainable=trainable, **factory)
