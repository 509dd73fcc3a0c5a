"""Walks: identification of an actuator's friction from its own motion in steps, with posterior and
intervals."""
