"""The model's inverse dynamics fed forward, with feedback, and the adaptive kind of it."""
