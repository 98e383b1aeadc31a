"""Model, simulation and Gymnasium environments of a mecanum platform."""

__version__ = "0.1.0"
