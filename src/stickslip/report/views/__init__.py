"""Views of results for reports, notebooks and terminals: one module for each type of result."""
