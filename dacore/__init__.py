"""dacore: from a few measurements of a physical system to its whole state, with honest uncertainty."""

__version__ = "0.1.0"
