"""Many flights of one robot at once: steps of a batch of states, each with its own parameters."""
