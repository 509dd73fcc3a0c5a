"""History of a laboratory: an index of the runs (recordings, fits) in a folder, which can be made again from
the files at any time; a log of actions on the runs; and their differences."""

from .acts import note_act as note_act
from .acts import read_acts as read_acts
from .comparing import differences as differences
from .index import Index as Index
from .table import runs as runs
