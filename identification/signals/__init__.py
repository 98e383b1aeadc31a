"""Filters, resampling and noise of sampled signals; nothing here knows a robot."""
