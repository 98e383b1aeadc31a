"""Trained policies as controllers, and their files."""
