"""Checks of generated modules against formulations that share no code with the derivation.

Left of this package stand the robot's data and the generated module; nothing here imports SymPy.
"""
