"""The batch's source on a GPU: the same episodes as the processor's, and machine code for one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import cuda

from tests.youbot_env.gpu.beside_processor import CASES, differences

HERE = Path(__file__).parent


def simulated(*arguments: str) -> dict[str, float]:
    """What ``beside_processor`` prints, in a process with the simulator."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(HERE.parents[2])}
    command = [sys.executable, str(HERE / "beside_processor.py"), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check(case: str, dtype: str) -> None:
    found = simulated(case, dtype)
    assert found.pop("ended") >= 1
    # The simulator rounds a product before it is added to. Observations are in single precision.
    assert max(found.values()) < (5e-7 if dtype == "float64" else 2e-5), found
    if dtype == "float64":
        assert found["reward"] < 1e-12


def test_episodes_are_those_of_the_processor() -> None:
    check("usual", "float64")


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("case", CASES)
def test_with_other_options_too(case: str, dtype: str) -> None:
    check(case, dtype)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("case", CASES)
def test_a_gpu_drives_as_the_processor(case: str, dtype: str) -> None:
    """Only where there is one. More copies than threads of a block, and than episodes at once."""
    if not cuda.is_available():
        pytest.skip("no CUDA device on this machine")
    found = differences(case, dtype, copies=3000)
    assert found.pop("ended") >= 1
    # A GPU's square roots and divisions are rounded otherwise.
    assert max(found.values()) < (5e-6 if dtype == "float64" else 1e-3), found


COMPILED = """
import sys
from types import SimpleNamespace
import numba.cuda.dispatcher as dispatcher
dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=(9, 0))
from tests.youbot_env.gpu.signatures import ptx
for name, text in ptx(sys.argv[1]).items():
    print(name, ".visible .entry" in text, "sm_90" in text)
"""


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_kernels_compile_for_a_gpu_that_is_not_there(dtype: str) -> None:
    pytest.importorskip("numba_cuda", reason="extra gpu: numba-cuda with its compiler")
    root = str(HERE.parents[2])
    done = subprocess.run(
        [sys.executable, "-c", COMPILED, dtype],
        env=os.environ | {"PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["step", "True", "True", "begin", "True", "True"]


def test_no_gpu_is_one_clear_line() -> None:
    from youbot_env import InputError
    from youbot_env.gpu import GpuBatch

    with pytest.raises(InputError, match=r"no CUDA device is found; pip install .youbot\[gpu\]"):
        GpuBatch(4)
