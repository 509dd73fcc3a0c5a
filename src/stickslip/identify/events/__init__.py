"""Slips and stick-slip events, without a model and with one."""
