"""The workbench: logs, models and what is missing, in a browser on this machine."""
