"""Campaigns: identification of an actuator from recordings in stages (hysteresis, stage, friction), and
verification on further recordings [kang2007, ch. 5].
"""

from .running import run_campaign as run_campaign
