"""How the code is laid out, measured from its own imports and definitions."""
