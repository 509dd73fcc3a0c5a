# isort: skip_file

# Sub-packages: what is not daily work
from . import control as control
from . import design as design
from . import estimate as estimate
from . import export as export
from . import friction as friction
from . import history as history
from . import identify as identify
from . import jobs as jobs
from . import panel as panel
from . import parameters as parameters
from . import physics as physics
from . import quantities as quantities
from . import recording as recording
from .quantities import registry as registry
from . import report as report
from . import rig as rig
from . import simulation as simulation
from . import study as study
from . import waveform as waveform

# Models, and where their numbers are from
from .physics.actuator import Actuator as Actuator
from .physics.actuator import load_actuator as load_actuator
from .quantities import QuantityError as QuantityError

# Friction laws
from .friction import LAWS as LAWS
from .friction import Coulomb as Coulomb
from .friction import CoulombViscous as CoulombViscous
from .friction import Dahl as Dahl
from .friction import Elastoplastic as Elastoplastic
from .friction import LuGre as LuGre
from .friction import MaxwellSlip as MaxwellSlip
from .friction import ResetIntegrator as ResetIntegrator
from .friction import StictionCoulombViscous as StictionCoulombViscous
from .friction import Stribeck as Stribeck

# Drive signals
from .waveform import Constant as Constant
from .waveform import PeriodicKnots as PeriodicKnots
from .waveform import Rest as Rest
from .waveform import ReverseSawtooth as ReverseSawtooth
from .waveform import Sampled as Sampled
from .waveform import Sawtooth as Sawtooth
from .waveform import Sequence as Sequence
from .waveform import Sine as Sine
from .waveform import Step as Step

# Simulation
from .simulation import friction_response as friction_response
from .simulation import simulate as simulate
from .simulation import simulate_ensemble as simulate_ensemble
from .simulation import steady_step as steady_step
from .simulation import steady_steps as steady_steps

# Recordings
from .recording.readers import inspect_file as inspect_file
from .recording.readers import read_recording as read_recording
from .recording import make_recording as make_recording
from .recording import open_recording as open_recording
from .recording import save_recording as save_recording

# Rigs
from .rig import Capture as Capture
from .rig import Channel as Channel
from .rig import Limits as Limits
from .rig import VirtualRig as VirtualRig
from .rig import load_bench as load_bench
from .rig import measure as measure

# Identification and verification
from .estimate import Fit as Fit
from .identify import identify_frequency as identify_frequency
from .identify import identify_friction as identify_friction
from .identify import identify_loops as identify_loops
from .identify import identify_piezo as identify_piezo
from .identify import identify_step as identify_step
from .identify import inverse_drive as inverse_drive
from .identify import load_fit as load_fit
from .identify import posterior as posterior
from .identify import save_fit as save_fit
from .identify.verification import verify as verify

# Design
from .design import from_data_sheet as from_data_sheet
from .design import optimise_waveform as optimise_waveform
from .design import step_map as step_map
from .design import plan_experiment as plan_experiment

# Reports, pictures, files whose steps do all of this, studies of many members
from .report.figures.plotting import bode as bode
from .report.figures.plotting import plot as plot
from .report import view as view
from .jobs import run_job as run_job
from .study import run_study as run_study
from ._version import __version__ as __version__
