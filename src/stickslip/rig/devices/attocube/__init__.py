"""Controllers of attocube: a client of the ANC300; `twin` simulates the device."""

from .anc300 import Anc300Client as Anc300Client
