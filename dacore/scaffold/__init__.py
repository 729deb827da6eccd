"""Distributions to begin with: `dacore new-plugin` writes them from the templates in this package."""
