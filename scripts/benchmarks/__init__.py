"""Speed of the simulator beside its peers: what `youbot benchmark` measures."""
