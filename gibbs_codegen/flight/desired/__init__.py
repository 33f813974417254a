"""The desired motion: paths and postures made coordinates, rates and accelerations in time."""
