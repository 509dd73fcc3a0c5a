"""Detection of slips and stick-slip events in recordings, and friction from them."""
