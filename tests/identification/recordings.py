"""Logs of known plants, recorded once for all tests of a run."""

from functools import cache

from controllers.recording import record
from identification.logs.log import Log
from youbot_env.model.model_file import load_model
from youbot_env.motions.calibration import calibration, motion_i, motion_iii

MOTIONS = {"calibration": calibration, "I": motion_i, "III": motion_iii}


@cache
def recording(
    motion: str = "calibration",
    effects: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = (),
    rate: float = 100.0,
    seed: int = 1,
    noise: float = 1.0,
) -> Log:
    """A log of the paper's platform (with effects), with ``noise`` times the usual noise."""
    plant = load_model("paper")
    for name, values in effects:
        plant = plant.with_effect(name, **dict(values))
    logs = record(
        plant,
        [MOTIONS[motion]()],
        rate=rate,
        seed=seed,
        torque_noise=0.03 * noise,
        speed_noise=0.01 * noise,
    )
    return logs[0]
