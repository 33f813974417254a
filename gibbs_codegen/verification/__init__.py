"""Checks of generated modules against formulations that share no code with the derivation.

They know the robot's data and the generated module; nothing here imports SymPy.
"""
