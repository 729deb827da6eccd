"""Domains that need no other package."""
