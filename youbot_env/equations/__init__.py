"""The equations of motion in print, from the functions that are simulated."""
