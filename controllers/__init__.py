"""Controllers that track a body twist with wheel torques."""
