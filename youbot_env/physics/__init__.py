"""Inverse dynamics, the only physics that is written down, and the effects that it is made of."""
