"""Clients of devices, and twins (simulated devices): one folder for each maker.

The package finds the folders by itself, so there is no list of them. `__init__.py` of a folder imports its
clients. Each registers itself in `registry.rigs` (puts out a drive and
records) or `registry.positioners` (executes a number of steps), with a description `about`. `twin.py`
registers twins in `registry.twins`: functions that take stages, seed and clock and return a twin. `README.md`
is the page of the devices in the documentation.

The search for devices at an address tries each client whose `about.ports` is not None: it opens the client,
or calls its static method `identify(host, port, timeout)`, which returns the identity that the device
reports. A static method `attached()` lists the devices that a maker's library finds on this machine.
"""
