"""Friction loops and driven masses: identification from measured force and motion."""
