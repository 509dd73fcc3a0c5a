"""Common parts of all identifications: channels, drive and noise of a recording."""
