"""Errors of the gate."""


class GateError(ValueError):
    """A file that is not let in; the message names the file and says why, and what to do."""


class GateBusy(GateError):
    """A file that was not read, though nothing is wrong with it as far as known: try again."""
