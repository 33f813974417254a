"""Robots as plain data and numbers: their files, coordinates, chains and rotors."""
