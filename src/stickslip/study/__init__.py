"""Studies: many members, on one machine or many, that go on after whatever ended them.

A `Study` says which members (`Grid`, `Random`, `Draws`, or several of them), what is done with each
(`SteadySteps`, `WalksFromRest`, a function of your `Own`) and what is kept. `run_study` fills a store that
xarray opens while it grows; docs/scaling.md says how to run one on clusters.
"""

from .comparing import Compared as Compared
from .comparing import Comparison as Comparison
from .comparing import compare_studies as compare_studies
from .comparing import merge_studies as merge_studies
from .design import Study as Study
from .drawn import drawn_parameters as drawn_parameters
from .errors import StudyDiffers as StudyDiffers
from .errors import StudyError as StudyError
from .exports import export_study as export_study
from .measures import Own as Own
from .measures import SteadySteps as SteadySteps
from .measures import WalksFromRest as WalksFromRest
from .own import OwnFunction as OwnFunction
from .points import Draws as Draws
from .points import Grid as Grid
from .points import Random as Random
from .points import Range as Range
from .reading import open_study as open_study
from .running import Estimate as Estimate
from .running import estimate_study as estimate_study
from .running import run_study as run_study
from .state import State as State
from .state import stop_study as stop_study
from .state import study_state as study_state
