"""Friction laws: a record and one compiled function each. See `law` for what that means."""

from .coulomb import Coulomb as Coulomb
from .coulomb import CoulombViscous as CoulombViscous
from .dahl import Dahl as Dahl
from .elastoplastic import Elastoplastic as Elastoplastic
from .law import breakaway as breakaway
from .law import element as element
from .law import elements as elements
from .law import force as force
from .law import is_law as is_law
from .law import project as project
from .law import rate as rate
from .law import register as register
from .law import register as register_law  # noqa: F401  (its public name)
from .lugre import LuGre as LuGre
from .maxwell_slip import MaxwellSlip as MaxwellSlip
from .reset_integrator import ResetIntegrator as ResetIntegrator
from .stribeck import StictionCoulombViscous as StictionCoulombViscous
from .stribeck import Stribeck as Stribeck

LAWS = (
    Coulomb,
    CoulombViscous,
    StictionCoulombViscous,
    Stribeck,
    Dahl,
    ResetIntegrator,
    LuGre,
    Elastoplastic,
    MaxwellSlip,
)
