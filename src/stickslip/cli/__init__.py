"""The command line: parse, call the library, print. Nothing is computed here.

Imports are inside the commands, so that ``stickslip --help`` does not load the solver. Exit codes: 0 done, 1
failed, 2 wrong input, 130 interrupted; an error is one line on stderr.
"""

# The module frame is imported first, because it reports an error if the package typer is missing.
from .frame import app as app

# isort: split
from . import commands as commands
from . import control as control
from . import data_sheet as data_sheet
from . import export as export
from . import history as history
from . import inspection as inspection
from . import interlock as interlock
from . import laboratory as laboratory
from . import panel as panel
from . import steps as steps
from . import study as study
