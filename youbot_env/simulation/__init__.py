"""Compiled simulation, generated from the physics: steppers, free runs, plants."""
