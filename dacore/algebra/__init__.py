"""Linear algebra of its own kind; every algorithm checks its own result."""
