"""Regression, covariance, observability, and the identification of a model from logs."""
