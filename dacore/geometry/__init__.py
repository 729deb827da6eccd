"""Simplices: point location, clipping, quality, meshing of level sets."""
