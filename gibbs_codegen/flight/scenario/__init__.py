"""Scenarios as plain data: paths, orientations, and the scenario file."""
