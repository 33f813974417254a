"""C of flights: the closed loop in fixed steps."""
