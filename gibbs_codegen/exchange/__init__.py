"""Robots from and to other formats: URDF, xacro and MJCF."""
