"""The cache of compiled kernels: read-only homes, changed physics, two processes, damage."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from youbot_env.model.model_file import load_model
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.catalogue import wheel_coulomb_friction
from youbot_env.physics.effect import CATALOGUE
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.simulation import compiled as kernels
from youbot_env.simulation.generated_code import System
from youbot_env.simulation.lane_kernel import stepper

BASE = mecanum_structure()

PROGRAM = """
import sys, warnings
warnings.simplefilter("error")
import numpy as np
from youbot_env.model.model_file import load_model
from youbot_env.simulation.free_run import initial_state, simulate
m = load_model("paper")
states = simulate(m, np.arange(5) * 0.01, np.ones((5, 4)), initial_state(m))
print(repr(states[-1, 0]))
"""

ROOT = Path(__file__).parents[3]


def start(folder: Path | str, prefix: Sequence[str] = ()) -> subprocess.Popen[str]:
    environment = os.environ | {
        "YOUBOT_CACHE_DIR": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": str(ROOT),
    }
    return subprocess.Popen(
        [*prefix, sys.executable, "-c", PROGRAM],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def answer(process: subprocess.Popen[str]) -> float:
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert not err
    return float(out.replace("np.float64(", "").rstrip(")\n"))


@pytest.fixture(scope="module")
def expected() -> float:
    """What each process must find: four steps from rest under 1 N m at each wheel."""
    m = load_model("paper")
    state = np.zeros((1, 11))
    stepper(m.structure)(state, np.ones((1, 4)), m.lengths, m.theta[None], 0.04, 400)
    return state[0, 0]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory, expected: float) -> Path:
    """A cache that two processes filled at once, both finding it empty."""
    folder = tmp_path_factory.mktemp("kernels") / "new"
    first, second = start(folder), start(folder)
    assert answer(first) == pytest.approx(expected, rel=1e-6)
    assert answer(second) == pytest.approx(expected, rel=1e-6)
    return folder


def contents(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_two_processes_fill_one_cache(filled: Path):
    names = [path.name for path in contents(filled)]
    assert sum(name.endswith(".py") for name in names) == 1
    assert any(name.endswith(".nbi") for name in names)
    assert not any(name.endswith(".tmp") for name in names)


def test_a_second_run_compiles_nothing(filled: Path, expected: float):
    before = {path: path.stat().st_mtime_ns for path in contents(filled)}
    assert answer(start(filled)) == pytest.approx(expected, rel=1e-6)
    assert {path: path.stat().st_mtime_ns for path in contents(filled)} == before


@pytest.mark.parametrize("kind", [".py", ".nbi", ".nbc"])
def test_damage_is_healed(filled: Path, expected: float, kind: str):
    """Torn by a crash or a full disk: half of each file is gone."""
    for path in contents(filled):
        if path.suffix == kind:
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert answer(start(filled)) == pytest.approx(expected, rel=1e-6)
    whole = {path: path.stat().st_mtime_ns for path in contents(filled)}
    assert answer(start(filled)) == pytest.approx(expected, rel=1e-6)
    assert {path: path.stat().st_mtime_ns for path in contents(filled)} == whole


def test_a_file_that_says_something_else_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Valid Python with another number in it: the checksum tells."""
    monkeypatch.setenv("YOUBOT_CACHE_DIR", str(tmp_path))
    path = kernels._cached_source(BASE, System(dynamics))
    good = path.read_text()
    assert kernels._is_intact(path)
    for bad in (good.replace("4.0", "5.0", 1), "", "# nothing", good + "\n", "\0\xff"):
        path.write_text(bad)
        assert not kernels._is_intact(path)
        assert kernels._cached_source(BASE, System(dynamics)) == path and path.read_text() == good


def test_a_cache_that_cannot_be_made_costs_only_time(expected: float, tmp_path: Path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert answer(start(blocked / "kernels")) == pytest.approx(expected, rel=1e-6)
    assert blocked.read_text() == "not a folder"


def read_only(folder: Path) -> list[str]:
    """A prefix for a command that may not write to a folder: for root, a mount of its own."""
    if os.geteuid() != 0:
        folder.chmod(0o555)
        (folder / "__pycache__").chmod(0o555)
        return []
    mount = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && exec "$@"'
    prefix = ["unshare", "-m", "sh", "-c", mount, str(folder)]
    try:
        subprocess.run([*prefix, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("root cannot make a read-only folder here")
    return prefix


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="concerns POSIX permissions")
def test_a_read_only_cache(filled: Path, expected: float):
    """Such as an administrator's: what is in it is left alone."""
    prefix, before = read_only(filled), contents(filled)
    try:
        assert answer(start(filled, prefix)) == pytest.approx(expected, rel=1e-6)
    finally:
        filled.chmod(0o755)
        (filled / "__pycache__").chmod(0o755)
    assert contents(filled) == before


# --- the key ---------------------------------------------------------------------------------


def key_with(monkeypatch: pytest.MonkeyPatch, function) -> str:
    """The key of a structure whose Coulomb friction is another function."""
    changed = replace(CATALOGUE["wheel_coulomb_friction"], function=function)
    with monkeypatch.context() as patch:
        patch.setitem(CATALOGUE._effects, "wheel_coulomb_friction", changed)
        return kernels._key(mecanum_structure(("wheel_coulomb_friction",)), System(dynamics))


SCALE = 1.0


def _helper(x):
    return 2.0 * x


def test_the_key_follows_the_physics(monkeypatch: pytest.MonkeyPatch):
    """Other operations, constants, globals, closures, helpers, lambdas: each is another key."""

    def closure(factor):
        return lambda xp, wheel, torque, smoothing: factor * torque * xp.tanh(wheel.rate)

    def nested(xp, wheel, torque, smoothing):
        return (lambda x: 3.0 * x)(torque)

    def nested_other(xp, wheel, torque, smoothing):
        return (lambda x: 4.0 * x)(torque)

    def scaled(xp, wheel, torque, smoothing):
        return SCALE * torque

    def helped(xp, wheel, torque, smoothing):
        return _helper(torque)

    variants = [
        wheel_coulomb_friction,
        lambda xp, wheel, torque, smoothing: torque * xp.tanh(wheel.rate / smoothing) * 2,
        lambda xp, wheel, torque, smoothing: torque * xp.sin(wheel.rate / smoothing),
        lambda xp, wheel, torque, smoothing: torque * xp.tanh(wheel.angle / smoothing),
        closure(1.0),
        closure(2.0),
        nested,
        nested_other,
        scaled,
        helped,
    ]
    keys = [key_with(monkeypatch, function) for function in variants]
    monkeypatch.setattr(sys.modules[__name__], "SCALE", 2.0)
    keys.append(key_with(monkeypatch, scaled))
    monkeypatch.setattr(sys.modules[__name__], "_helper", lambda x: 3.0 * x)
    keys.append(key_with(monkeypatch, helped))
    assert len(set(keys)) == len(keys)


def test_the_key_is_that_of_the_last_process(filled: Path):
    """Otherwise every start would compile anew."""
    assert (filled / f"kernel_{kernels._key(BASE, System(dynamics))}.py").exists()


def test_comments_and_values_leave_the_key(monkeypatch: pytest.MonkeyPatch):
    def documented(xp, wheel, torque, smoothing):
        # a comment
        return torque * xp.tanh(wheel.rate / smoothing)

    def bare(xp, wheel, torque, smoothing):
        return torque * xp.tanh(wheel.rate / smoothing)

    assert key_with(monkeypatch, documented) == key_with(monkeypatch, bare)
