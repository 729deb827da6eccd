"""Abstractions and values: spaces, discretisation, models, observation, estimation."""
