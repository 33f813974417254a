"""Robot files that ship with the package."""
