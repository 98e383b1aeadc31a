"""PID on the body twist."""
