"""What the engine knows of a mechanism, and the mechanisms that there are."""
