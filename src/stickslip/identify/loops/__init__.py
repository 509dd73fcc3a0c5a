"""Friction loops and driven masses: force and motion are measured."""
