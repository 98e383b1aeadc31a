"""A plant with real rollers on a floor, simulated by MuJoCo."""
