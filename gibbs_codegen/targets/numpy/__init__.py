"""NumPy: one module of straight-line functions, and the package around it."""
