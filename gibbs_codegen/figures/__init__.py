"""Every picture: of a robot's structure, of its chains, of a flight."""
