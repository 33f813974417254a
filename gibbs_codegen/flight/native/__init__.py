"""C of the simulator: the closed loop in fixed steps."""
