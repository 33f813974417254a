"""Robots from and to other formats: URDF, xacro, MJCF and SDF."""
