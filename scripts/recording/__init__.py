"""Driving a simulated platform through motions and writing its logs."""
