"""Comparison of friction laws by small simulated experiments, and the limits in which one law becomes
another."""

from .laws import LawCharacter as LawCharacter
from .laws import characterise_laws as characterise_laws
from .laws import example_laws as example_laws
from .limits import Limit as Limit
from .limits import compare_limits as compare_limits
from .tables import laws_as_markdown as laws_as_markdown
from .tables import limits_as_markdown as limits_as_markdown
