"""The files that `export` writes: which function of a package makes each form of a model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from youbot_env.errors import InputError, finite
from youbot_env.files import json_text, write_atomically

if TYPE_CHECKING:
    from controllers.interface import Loop
    from youbot_env.physics.geometry import Geometry


@dataclass(frozen=True)
class LoopOptions:
    """The loop of the exported controller, as options state it.

    rate [Hz]; delay and age in samples; noise [rad/s]; torque_limit [N m] and bandwidth [rad/s],
    None for the defaults
    """

    rate: float
    delay: float
    age: float
    noise: float
    torque_limit: float | None
    bandwidth: float | None

    def loop(self, geometry: Geometry) -> Loop:
        """The same in SI units, with a platform's torque limit where none is stated."""
        from controllers.interface import Loop

        period = 1.0 / finite("--rate [Hz]", self.rate, positive=True)
        return Loop(
            sample_time=period,
            delay=finite("--delay", self.delay, least=0.0) * period,
            measurement_delay=finite("--age", self.age, least=0.0) * period,
            torque_limit=geometry.max_wheel_torque
            if self.torque_limit is None
            else self.torque_limit,
            speed_noise=self.noise,
        )


def exported(model: str, form: str, name: str, options: LoopOptions) -> dict[str, str]:
    """Text by name of file.

    Raises
    ------
    InputError
        If the model cannot be read, or not be written in this form.
    """
    if form == "c":
        from controllers.computed_torque.c_code import computed_torque_to_c
        from youbot_env.model.model_file import load_model

        loop = options.loop(load_model(model).geometry)
        return computed_torque_to_c(model, loop, name=name, bandwidth=options.bandwidth)
    from youbot_env.exports.c_code import checked_name

    checked_name(name)
    if form == "mjcf":
        from youbot_env.exports.mujoco_bodies import to_mjcf

        return {f"{name}.xml": to_mjcf(model)}
    from youbot_env.model.model_file import load_model, model_to_dict

    return {f"{name}.json": json_text(model_to_dict(load_model(model)))}


def write_files(folder: Path, files: Mapping[str, str]) -> list[Path]:
    """Write texts into a folder, which is made where it is missing; each whole or not at all.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    paths = [folder / name for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        write_atomically(path, text)
    return paths
