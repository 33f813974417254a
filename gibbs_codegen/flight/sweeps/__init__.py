"""Studies of many flights: cases, their chunks on any executor, and tables of results."""
