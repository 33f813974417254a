"""Simulation of generated modules: desired motion, control, integration, results.

Knows generated modules, NumPy and SciPy, and nothing of the derivation.
"""
