"""What is computed with estimates: validation, dimension."""
