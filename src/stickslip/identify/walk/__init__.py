"""Identification of an actuator's friction from recordings of its own stick-slip motion (walks), with
posterior distributions and intervals."""
