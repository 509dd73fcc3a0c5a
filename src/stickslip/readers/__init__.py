"""Readers of the files that measurements come in."""

from .reading import read_recording as read_recording
