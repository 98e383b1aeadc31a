"""Motions and plants as they are named on the command line."""
