"""Amplifiers of piezosystem jena."""

from .nv200 import Nv200Rig as Nv200Rig
