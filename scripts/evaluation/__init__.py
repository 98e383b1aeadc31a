"""Controllers compared on plants: conditions, closed loops, metrics, tables and pictures."""
