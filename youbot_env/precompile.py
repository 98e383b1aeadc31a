"""Compiles what environments run, once: ``python -m youbot_env.precompile``.

The first environment on a machine waits for the compiler, some 15 s of one core. Where a machine is
made once and used often, an image of a container or the folder that a cluster shares, this is the
line for its making. What is compiled lies beside the package where it can be written to, and else
in the folder of ``YOUBOT_CACHE_DIR``. It holds for one kind of processor and versions of numba and
this package; elsewhere it is compiled again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping

import numpy as np

DRAWN = {"m0": ("90%", "110%")}
"""So that what draws models is compiled too."""


def parts() -> Mapping[str, Callable[[], None]]:
    """What is compiled, in words, each with what has it compiled."""
    return {
        "environments in double precision": lambda: _environment("float64"),
        "environments in single precision": lambda: _environment("float32"),
        "Plant, free runs, inverse dynamics": _model,
    }


def _environment(dtype: str) -> None:
    from youbot_env.tracking.batch import Batch
    from youbot_env.tracking.options import tracking_setup

    rows = Batch(tracking_setup(randomise=DRAWN, dtype=dtype), 1)
    rows.begin(keys=np.zeros(1, np.int64))
    rows.step(np.zeros((1, 4), np.float32))


def _model() -> None:
    from youbot_env.model.model_file import load_model
    from youbot_env.physics import inverse_dynamics
    from youbot_env.simulation.compiled import inverse_kernel
    from youbot_env.simulation.free_run import initial_state, simulate
    from youbot_env.simulation.plant import Plant

    model = load_model("paper")
    Plant(model).step(np.zeros(4), 0.01)
    simulate(model, np.arange(2) * 0.01, np.zeros((2, 4)), initial_state(model))
    inverse_kernel(model.structure, inverse_dynamics)


def main() -> int:
    """Compile all of it, and say what is being compiled."""
    for what, compiled in parts().items():
        print(f"compiling: {what}", flush=True)
        compiled()
    return 0


if __name__ == "__main__":
    sys.exit(main())
