"""Views of results for reports, notebooks and terminals: one module for each type, or group of types."""
