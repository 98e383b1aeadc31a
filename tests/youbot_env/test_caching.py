"""Caches of compiled code: damaged, unwritable, somebody else's, or none at all."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from youbot_env import caching
from youbot_env.physics import inverse_dynamics as dynamics
from youbot_env.physics.mecanum import mecanum_structure
from youbot_env.simulation import compiled as kernels
from youbot_env.simulation.generated_code import System

ROOT = Path(__file__).parents[2]
BASE = mecanum_structure()

MODULE = """
from youbot_env.caching import njit

@njit(cache=True, error_model="numpy")
def double(x):
    return 2.0 * x
"""

POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="concerns POSIX permissions")
AS_ROOT = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away"
)


def doubled(folder: Path) -> tuple[float, int]:
    """What the function of ``MODULE`` returns as a new process would load it, and how often it was
    found in the cache."""
    spec = importlib.util.spec_from_file_location("mine", folder / "mine.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.double(1.5), sum(module.double.stats.cache_hits.values())


@pytest.fixture
def module(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(MODULE)
    return tmp_path


def test_code_is_compiled_anew_where_another_module_of_ours_has_changed(
    module: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its constants are in the machine code of all that use them."""
    assert doubled(module) == (3.0, 0) and doubled(module) == (3.0, 1)
    before = caching.code_stamp()
    monkeypatch.setattr(caching, "code_stamp", lambda: "of another version")
    assert doubled(module) == (3.0, 0) and doubled(module) == (3.0, 1)
    monkeypatch.setattr(caching, "code_stamp", lambda: before)
    assert doubled(module) == (3.0, 0)


@pytest.mark.parametrize("changed", ["simulation/lane_code.py", "tracking/period_lanes.py"])
def test_the_stamp_follows_the_sources(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = tmp_path / "youbot_env"
    shutil.copytree(Path(caching.__file__).parent, package, ignore=shutil.ignore_patterns("*.nb?"))
    monkeypatch.setattr(caching, "__file__", str(package / "caching.py"))
    first = caching.code_stamp.__wrapped__()
    assert first == caching.code_stamp()
    (package / changed).write_text((package / changed).read_text() + "MORE = 1\n")
    assert caching.code_stamp.__wrapped__() != first


def test_a_cache_beside_the_package_is_used_and_damage_is_passed_over(module: Path):
    assert doubled(module) == (3.0, 0)
    assert doubled(module) == (3.0, 1)
    for ending in ("nbi", "nbc"):
        for damage in (
            lambda whole: whole[: len(whole) // 2],
            lambda _: b"",
            lambda _: b"\x80junk",
        ):
            for path in (module / "__pycache__").glob(f"*.{ending}"):
                path.write_bytes(damage(path.read_bytes()))
            assert doubled(module) == (3.0, 0)
        assert doubled(module) == (3.0, 1), "the cache is whole again"


def test_without_a_folder_numba_would_raise_and_we_compile(monkeypatch, tmp_path: Path):
    def no_folder(function):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(caching, "_cache_kind", lambda: no_folder)
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(tmp_path / "kernels"))
    assert caching.njit(cache=True)(lambda x: x + 1.0)(1.0) == 2.0
    monkeypatch.setattr(caching, "cache_folder", lambda: None)
    assert caching.njit(cache=True)(lambda x: x + 1.0)(1.0) == 2.0


def test_the_setting_of_other_code_stays(monkeypatch, tmp_path: Path):
    import numba

    seen = []

    def kind(function):
        seen.append(numba.config.CACHE_DIR)  # pyright: ignore
        raise RuntimeError

    monkeypatch.setattr(caching, "_cache_kind", lambda: kind)
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(tmp_path / "kernels"))
    before = numba.config.CACHE_DIR  # pyright: ignore
    caching.njit(cache=True)(lambda x: x)
    assert seen == [before, str(tmp_path / "functions")]
    assert numba.config.CACHE_DIR == before  # pyright: ignore


def test_no_function_is_cached_by_numba_itself():
    """Its own cache raises where it cannot be written, or is damaged."""
    for package in ("youbot_env", "identification", "controllers", "scripts"):
        for path in (ROOT / package).rglob("*.py"):
            if path.name != "caching.py":
                text = path.read_text("utf-8")
                assert "from numba import" not in text and "numba.njit" not in text, path


# --- folders ---------------------------------------------------------------------------------


@POSIX
def test_a_new_folder_is_for_its_user_alone(monkeypatch, tmp_path: Path):
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(tmp_path / "a" / "b"))
    folder = caching.cache_folder()
    assert folder is not None and folder == tmp_path / "a" / "b"
    assert folder.stat().st_mode & 0o777 == 0o700


@POSIX
def test_a_folder_of_ours_that_others_could_write_to_is_closed(monkeypatch, tmp_path: Path):
    folder = tmp_path / "open"
    folder.mkdir()
    folder.chmod(0o777)
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(folder))
    assert caching.cache_folder() == folder
    assert folder.stat().st_mode & 0o777 == 0o700


@AS_ROOT
def test_a_strangers_folder_is_not_used(monkeypatch, tmp_path: Path):
    folder = tmp_path / "theirs"
    folder.mkdir()
    os.chown(folder, 12345, 12345)
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(folder))
    with pytest.warns(UserWarning, match="other users can write to it"):
        assert caching.cache_folder() is None


@AS_ROOT
@pytest.mark.parametrize("what", ("source", "machine code"))
def test_what_a_stranger_put_into_the_folder_is_not_loaded(what, monkeypatch, tmp_path: Path):
    monkeypatch.setenv(caching.CACHE_VARIABLE, str(tmp_path / "kernels"))
    path = kernels._cached_source(BASE, System(dynamics))
    assert kernels._is_intact(path)
    planted = path
    if what == "machine code":
        planted = path.parent / "__pycache__" / f"{path.stem}.x.nbc"
        planted.parent.mkdir(mode=0o700)
        planted.write_bytes(b"a pickle that runs code")
    os.chown(planted, 12345, 12345)
    assert not kernels._is_intact(path)
    assert kernels._cached_source(BASE, System(dynamics)) == path
    assert kernels._is_intact(path) and path.stat().st_uid == 0
    assert planted == path or not planted.exists()


def test_without_a_home_there_is_no_cache(monkeypatch, tmp_path: Path):
    monkeypatch.delenv(caching.CACHE_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(caching.platformdirs, "user_cache_dir", lambda name: f"~/.cache/{name}")
    assert caching.cache_folder() is None and not list(tmp_path.iterdir())

    def no_home(name):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.setattr(caching.platformdirs, "user_cache_dir", no_home)
    assert caching.cache_folder() is None
    source = kernels._cached_source(BASE, System(dynamics))
    assert source.is_file() and source.parent == caching.private_folder()


FIRST_USE = """
import sys
import gymnasium, youbot_env
env = gymnasium.make("YouBotTracking-v0")
env.reset(seed=0)
seen = env.step(env.action_space.sample())[0]
assert sys.argv[1] == "cold" or "scipy.linalg" not in sys.modules
import numba, numpy
product = numba.njit(lambda a, b: numpy.dot(a, b))(numpy.eye(2), numpy.arange(2.0))
assert product.tolist() == [0.0, 1.0]
"""


@pytest.mark.slow
def test_compiled_code_runs_without_what_compiling_needs_and_compiling_still_works():
    for state in ("cold", "warm"):
        subprocess.run([sys.executable, "-c", FIRST_USE, state], check=True)


def test_an_inner_function_is_called_by_compiled_code():
    half = caching.njit(inner=True)(lambda x: 0.5 * x)
    assert caching.njit()(lambda x: half(x) + 1.0)(3.0) == 2.5
