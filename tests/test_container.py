"""As in a container: a user without name and home, and a package that is read-only."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.test_wheel import PACKAGES

ROOT = Path(__file__).parents[1]
STRANGER = 12345
"""A user id that no machine has."""

pytestmark = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user"
)


@pytest.fixture(scope="module")
def container() -> Iterator[Path]:
    """A folder with the packages, read-only, and ``out``, which is the stranger's."""
    # Not pytest's folder, which is closed to others.
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for source, target in PACKAGES.items():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / source, folder / "packages" / target, ignore=ignored)
        for path in [folder, *folder.rglob("*")]:
            path.chmod(0o755 if path.is_dir() else 0o644)
        (folder / "out").mkdir()
        os.chown(folder / "out", STRANGER, STRANGER)
        yield folder


def libraries() -> list[str]:
    """Where this interpreter finds what the packages need."""
    known = sysconfig.get_paths()
    return [path for path in sys.path if path.endswith("site-packages")] or [known["purelib"]]


def run(container: Path, *arguments: str, timeout: float = 500) -> str:
    """Run Python as the stranger, in the root folder, without an environment."""
    interpreter = os.path.realpath(sys.executable)
    if not os.access("/usr/bin/setpriv", os.X_OK):
        pytest.skip("no setpriv on this machine: nobody else can be played")
    who = ["setpriv", f"--reuid={STRANGER}", f"--regid={STRANGER}", "--clear-groups"]
    # It must start again from within, as worker processes do: in a closed home it may not.
    again = "import subprocess, sys; subprocess.run([sys.executable, '-c', ''], check=True)"
    tried = subprocess.run([*who, interpreter, "-c", again], capture_output=True)
    if tried.returncode:
        interpreter = f"/usr/bin/python3.{sys.version_info.minor}"
        if not os.access(interpreter, os.X_OK):
            pytest.skip("this interpreter is closed to other users")
    path = os.pathsep.join([str(container / "packages"), *libraries()])
    done = subprocess.run(
        [*who, interpreter, *arguments],
        cwd="/",
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": path, "YOUBOT_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr
    return done.stdout


IMPORTS = """
import importlib
import youbot_env, identification, controllers
for package in (youbot_env, identification, controllers):
    for name in package.__all__:
        getattr(package, name)
from youbot_scripts import cli
for name in cli.COMMANDS:
    if name != "train":  # needs torch, which takes long to load
        importlib.import_module(f"youbot_scripts.{name}")
print(len(cli.COMMANDS))
"""


def test_everything_is_imported(container: Path):
    assert int(run(container, "-c", IMPORTS)) > 10


@pytest.mark.slow
def test_identify_environment_and_evaluate_run_with_outputs_elsewhere(container: Path):
    logs = [
        str(container / "packages/youbot_scripts/data" / f"{name}.csv.gz")
        for name in ("calibration", "multisine_a")
    ]
    out = container / "out"
    command = "-m", "youbot_scripts.cli"
    assert "written" in run(
        container,
        *command,
        "identify",
        *logs,
        "-o",
        str(out / "m.json"),
        "--json",
        str(out / "i.json"),
    )
    run(
        container,
        "-c",
        "import gymnasium\n"
        "env = gymnasium.make('youbot_env:YouBotTracking-v0')\n"
        "env.reset(seed=0)\n"
        "env.step(env.action_space.sample())",
    )
    run(
        container,
        *command,
        "evaluate",
        "--model",
        str(out / "m.json"),
        "--controllers",
        "computed_torque",
        "--seeds",
        "1",
        "--duration",
        "5",
        "--json",
        str(out / "e.json"),
        "--plots",
        str(out / "plots"),
    )
    assert {"m.json", "i.json", "e.json", "plots"} <= {path.name for path in out.iterdir()}
