"""Linear modes of bodies and the elements that act on them as one system of equations; see the module
`system`."""
