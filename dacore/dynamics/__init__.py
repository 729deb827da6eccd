"""Time schemes, marching of affine models, training."""
