"""Set up once for all tests."""

import os

# The processes of a parallel run share the cores already.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("YOUBOT_THREADS", "1")
