"""Tests of the import of foreign recordings."""
