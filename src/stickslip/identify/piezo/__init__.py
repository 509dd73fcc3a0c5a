"""Identification of hysteresis and creep of a piezo from recordings of voltage and displacement."""
