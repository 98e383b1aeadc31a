"""The `youbot` command: one short program per job."""
