"""Estimators: one a file."""
