"""A record of what the package does, to compare before and after its insides change."""
