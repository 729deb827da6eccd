"""The stages of a scene put together, and the report."""
