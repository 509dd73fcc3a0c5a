"""stickslip: identify, verify, simulate and design piezoelectric stick-slip actuators.

What daily work needs is here, everything else in sub-packages: ``ss.simulate``, ``ss.rig.VirtualRig``. Public
names are listed, with their types, in ``__init__.pyi``; each is imported when it is first used, so that
``import stickslip`` costs next to nothing.
"""

from ._lazy import attach as _attach

_imported, __dir__, __all__ = _attach(__name__, __file__)


def __getattr__(name: str) -> object:
    try:
        return _imported(name)
    except AttributeError:
        if name.startswith("_"):
            raise
        return _elsewhere(name)


# Rooms that came after: a name that they share with an older one meant that of the older.
_SINCE = ("contact", "control", "design", "positioners", "study", "twins")


def _elsewhere(name: str) -> object:
    """A name of a sub-package, where all names stood once; to be removed with 0.2."""
    from contextlib import suppress
    from pkgutil import iter_modules
    from warnings import warn

    rooms = {module.name for module in iter_modules(__path__)} & {*__all__}
    for room in sorted(rooms, key=lambda room: (room in _SINCE, room)):
        found = None
        with suppress(ModuleNotFoundError):  # of an extra, which need not be that of what is looked for
            found = getattr(_imported(room), name, None)
        if str(getattr(found, "__module__", "")).startswith(f"stickslip.{room}"):
            warn(f"stickslip.{name} is stickslip.{room}.{name}", DeprecationWarning, stacklevel=3)
            return found
    raise AttributeError(f"stickslip has no {name!r}, nor have its sub-packages")
