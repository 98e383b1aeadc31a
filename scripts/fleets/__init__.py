"""Many robots diagnosed: a folder of logs each, a result and a model each, and what they share."""
