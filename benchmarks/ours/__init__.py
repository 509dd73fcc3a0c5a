"""This package, measured by worker processes of the same kind as the peers'."""
