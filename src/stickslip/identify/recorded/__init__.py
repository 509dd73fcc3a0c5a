"""What every identification asks of a recording: its channels, its drive, what it shows of its noise."""
