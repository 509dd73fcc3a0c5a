"""Frequency responses and modal models, also for several drive amplitudes and in time, and corrections for
the instruments."""
