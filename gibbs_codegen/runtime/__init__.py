"""Generated modules, loaded and called: NumPy, or C that is compiled once and kept."""
