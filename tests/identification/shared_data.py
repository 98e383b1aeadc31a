"""Logs beside the project that may be used but not redistributed; tests skip without them."""

import json
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="shared logs are not at hand")


def truth(name: str) -> dict[str, float]:
    """The physical parameters that a simulated platform's logs were made with."""
    found = json.loads((DATA / name / "truth.json").read_text())
    keys = {"m0": "m0", "I0": "I0", "I1": "I1", "aX": "ax", "aY": "ay", "mu1": "mu1", "mu2": "mu2"}
    return {name: found[key] for name, key in keys.items()}


def theta(values: dict[str, float], wheel_mass: float = 1.4) -> np.ndarray:
    """Base theta (7,) of physical parameters."""
    mass = values["m0"] - 4 * wheel_mass
    order = ("m0", "I0", "m_aX", "m_aY", "I1", "mu1", "mu2")
    linear = values | {"m_aX": mass * values["aX"], "m_aY": mass * values["aY"]}
    return np.array([linear[name] for name in order])
