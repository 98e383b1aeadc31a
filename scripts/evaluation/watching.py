"""Single closed loops to be looked at: one plant, one reference, a controller after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from controllers.loop import Trace, closed_loop
from controllers.recording import generator
from controllers.registry import build, check
from youbot_env.model.model_file import load_model
from youbot_env.tracking.task import TrackingTask
from youbot_scripts.evaluation.conditions import KNOWN, LoopSettings, PlantSource, ReferenceMotion


def drive(
    plant: PlantSource,
    model: str,
    names: Sequence[str],
    settings: LoopSettings,
    reference: ReferenceMotion,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Trace]:
    """Traces of the controllers by name, all along the same reference with the same noise.

    Parameters
    ----------
    model : that the controllers are built on: a file, or "known", the plant's own
    progress : told the seconds driven since it was last told

    Raises
    ------
    InputError
        If plant, model or a controller's name is unknown, or a controller cannot be built on it.
    """
    for name in names:
        check(name)
    believed = plant.truth if model == KNOWN else load_model(model)
    loop, motion = settings.known(plant.truth.geometry), reference.motion(plant, seed, 0)
    bound = TrackingTask().largest_twist(plant.truth.geometry)
    return {
        name: closed_loop(
            plant.platform(),
            build(name, believed, loop),
            motion,
            loop,
            generator(seed, "watch"),
            count=round(reference.length / loop.sample_time),
            show_pose=settings.pose,
            bound=bound,
            progress=progress,
        )
        for name in names
    }
