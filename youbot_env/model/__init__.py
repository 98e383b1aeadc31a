"""A model: parameters with uncertainty, effects, geometry, history; and its file."""
