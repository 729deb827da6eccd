"""Meshes for tests of whatever stands on a mesh."""

from dacore.testing.meshes import shuffled_box

__all__ = ["shuffled_box"]
