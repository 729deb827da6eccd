"""Reduced models: an affine model marched on a few hundred coordinates, with an estimate of its error."""
