"""Reference motions of the platform: calibration, multisines, steps, and what they may ask for."""
