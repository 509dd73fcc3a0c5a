"""Identification of an actuator's friction from recordings of its own stick-slip motion (walks): fits,
intervals, posterior distributions, tests of the model, and comparison of laws."""
