"""The blind test bench: cases from a simulator of its own, diagnosed in bulk, and scored."""
