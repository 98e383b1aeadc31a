"""Linear quadratic control with integrals."""
