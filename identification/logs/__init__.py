"""Log files: read, checked, repaired, written."""
