"""Common needs of all identifications of a recording: channels, drive, and the noise that it shows."""
