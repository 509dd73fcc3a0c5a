"""Amplifiers of piezosystem jena: a rig that uses the NV200/D NET; `twin` simulates the device."""

from .nv200 import Nv200Rig as Nv200Rig
