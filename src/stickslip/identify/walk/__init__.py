"""Walks: an actuator's friction from its own motion; posterior, intervals, experiments and rivals."""
