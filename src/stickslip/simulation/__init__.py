"""Simulation: from a model and a drive signal to a labelled trajectory; the public calls over `engine`."""

from .ensemble import simulate_ensemble as simulate_ensemble
from .errors import NotPeriodicError as NotPeriodicError
from .errors import SimulationError as SimulationError
from .errors import SimulationWarning as SimulationWarning
from .periodic import Orbit as Orbit
from .prescribed import friction_response as friction_response
from .sensitivity import sensitivities as sensitivities
from .state import State as State
from .state import final_state as final_state
from .steady import steady_orbit as steady_orbit
from .steady import steady_step as steady_step
from .steady_derivatives import steady_step_derivatives as steady_step_derivatives
from .steady_members import steady_steps as steady_steps
from .ticks import Motion as Motion
from .together import simulate_together as simulate_together
from .trajectory import simulate as simulate
