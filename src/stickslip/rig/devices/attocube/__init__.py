"""attocube's controllers."""

from .anc300 import Anc300Client as Anc300Client
