"""Which variables predict what a model misses, on stretches that it has not seen."""
