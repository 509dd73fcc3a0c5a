"""Thorlabs' controllers."""

from .kim101 import Kim101Client as Kim101Client
