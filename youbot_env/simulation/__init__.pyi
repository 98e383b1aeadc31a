from .free_run import initial_state as initial_state, simulate as simulate
from .plant import Plant as Plant
