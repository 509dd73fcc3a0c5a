"""The error of the gate."""


class GateError(ValueError):
    """A file that is not let in; the message names the file and says why, and what to do."""
