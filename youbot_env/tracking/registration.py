"""Registration with Gymnasium, without an import of Gymnasium where only a model is needed."""

from __future__ import annotations

import importlib.util
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ENVIRONMENTS = {"YouBotTracking-v0": "youbot_env.tracking.env:YouBotTrackingEnv"}
"""Gymnasium ids and where the classes are. Episodes end by their own ``episode_length``."""

VECTOR_ENVIRONMENTS = {
    "YouBotTracking-v0": "youbot_env.tracking.vector_env:YouBotTrackingVectorEnv"
}
"""Their vector environments, for ``vectorization_mode="vector_entry_point"``."""

AWAITED = "gymnasium.envs"


def register() -> None:
    """Make the environments known to ``gymnasium.make``."""
    from gymnasium.envs import registration

    for name, entry_point in ENVIRONMENTS.items():
        if name not in registration.registry:
            registration.register(
                id=name,
                entry_point=entry_point,
                vector_entry_point=VECTOR_ENVIRONMENTS.get(name),
            )


def register_when_imported() -> None:
    """Register now if Gymnasium is there already, else as soon as somebody imports it.

    ``gym.make("youbot_env:...")`` does not run this package again when it was imported before
    Gymnasium, so waiting is the only way to serve both orders without a 0.2 s import here.
    """
    if AWAITED in sys.modules:
        register()
    elif not any(isinstance(finder, _Awaiting) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Awaiting())


class _Awaiting(MetaPathFinder):
    """Import hook: registers the environments after ``gymnasium.envs`` has been imported.

    It removes itself before it asks for the module's real spec, or it would find itself again.
    """

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname != AWAITED:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            # Registering needs the finished module, so it follows the loader's own work.
            run = spec.loader.exec_module

            def run_and_register(module: ModuleType) -> None:
                run(module)
                register()

            spec.loader.exec_module = run_and_register
        return spec
