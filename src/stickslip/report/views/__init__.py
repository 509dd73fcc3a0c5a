"""Views of results: what a report, a notebook and a terminal show of each type; a module for each."""
