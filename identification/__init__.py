"""Identification of the dynamic model from logs, and its comparison with measurements."""
