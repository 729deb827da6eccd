"""Stages in general: keys, cache, plan, runner."""
