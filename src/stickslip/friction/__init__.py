"""Friction laws, each a record with its functions (see `law` for the interface), and the normal force along
the stroke."""

from ..quantities import registry
from .law import Branches as Branches
from .law import breakaway as breakaway
from .law import element as element
from .law import elements as elements
from .law import force as force
from .law import is_law as is_law
from .law import project as project
from .law import rate as rate
from .law import register as register
from .law import register as register_law  # noqa: F401  (its public name)
from .normal_force import NormalForce as NormalForce

# The order of these imports is that of the laws in [kang2007], and so the order in all lists of laws. Laws
# from users' files follow.
# isort: off
from .coulomb import Coulomb as Coulomb
from .coulomb import CoulombViscous as CoulombViscous
from .stribeck import StictionCoulombViscous as StictionCoulombViscous
from .stribeck import Stribeck as Stribeck
from .dahl import Dahl as Dahl
from .reset_integrator import ResetIntegrator as ResetIntegrator
from .lugre import LuGre as LuGre
from .elastoplastic import Elastoplastic as Elastoplastic
from .maxwell_slip import MaxwellSlip as MaxwellSlip
# isort: on

# Friction laws that come with the package, without those from users' files.
LAWS: tuple[type, ...] = tuple(registry.laws.packaged().values())
