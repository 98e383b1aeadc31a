"""Tests of the blind bench that need no diagnosis."""
