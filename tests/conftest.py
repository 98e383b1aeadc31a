"""Set up once for all tests."""

import os
from collections.abc import Iterator

import pytest

# Commands that tests start keep their bytecode: without it each of them compiles all that it
# imports anew, 0.3 s of this package alone and 1 s of torch.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# As the commands have it: OpenBLAS' threads wait for each other by spinning, so where the cores
# have other work (a second process of a parallel run) an eigenvalue problem takes 36 times the CPU.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The processes of a parallel run share the cores already.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("YOUBOT_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(autouse=True)
def no_file_of_effects_stays() -> Iterator[None]:
    """Worker processes load what was loaded here: not the files of earlier tests."""
    # Here: what it imports may read what is set above.
    from youbot_env import plugins

    before = list(plugins._loaded)
    yield
    plugins._loaded[:] = before
