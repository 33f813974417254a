"""Version of the generator, which every emitted file names."""

__version__ = "0.1.0"
