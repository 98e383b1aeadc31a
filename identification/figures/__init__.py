"""Pictures of logs, models and residuals (needs matplotlib)."""
