"""Linear bodies and the elements that act on them, composed into one system of equations; see `system`."""
