"""Devices: one folder for each maker, which is found without being named anywhere else.

`__init__.py` of a folder imports its clients. Each registers itself in `registry.rigs` (puts out a drive and
records) or `registry.positioners` (receives a number of steps), with an `about`. `twin.py` registers twins in
`registry.twins`: functions from stages, seed and clock to a twin. `README.md` is the documentation's page.

A client with `about.ports` is asked when an address is searched: it is opened, or its static method
`identify(host, port, timeout)` returns what the device calls itself. A static method `attached()` lists the
devices that a library sees on this machine.
"""
