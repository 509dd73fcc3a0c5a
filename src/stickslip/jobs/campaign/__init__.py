"""Campaigns: from the recordings of a laboratory to a verified model of an actuator [kang2007, ch. 5]."""

from .running import run_campaign as run_campaign
