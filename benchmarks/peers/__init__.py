"""The other tools, each a worker process in an environment of its own (`.venv-peers`, `make peers`).

Their programs were written for this comparison, each the way its documentation advises, restarted where the
drive jumps, just as here. They know NumPy and what they measure, nothing of stickslip.
"""
