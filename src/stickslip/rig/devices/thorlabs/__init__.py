"""Controllers of Thorlabs: a client of the KIM101; `twin` simulates the device."""

from .kim101 import Kim101Client as Kim101Client
