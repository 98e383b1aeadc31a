"""Linear systems, stability margins, and the drives between command and torque."""
