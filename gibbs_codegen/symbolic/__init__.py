"""Scalars with names: the tape, vectors and rotations, and exact structural angles."""
