"""History of a laboratory: an index of the recordings and fits in a folder, which is made from the files and
can be made again at any time."""

from .acts import note_act as note_act
from .acts import read_acts as read_acts
from .comparing import differences as differences
from .index import Index as Index
from .table import runs as runs
