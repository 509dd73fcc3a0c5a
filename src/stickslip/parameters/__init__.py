"""Parameter sets of actuators: TOML files of values with units and sources, and the bibliography that they
cite."""

from .citations import bibtex as bibtex
from .citations import citation_keys as citation_keys
from .citations import cite as cite
from .citations import keys_in as keys_in
from .citations import print_citations as print_citations
from .citations import references as references
from .load import ParameterSet as ParameterSet
from .load import ParameterSetError as ParameterSetError
from .load import SetEntry as SetEntry
from .load import available_sets as available_sets
from .load import build as build
from .load import friction_of as friction_of
from .load import load_friction as load_friction
from .load import load_kind as load_kind
from .load import load_set as load_set
from .load import named_file as named_file
from .load import piezo_parts as piezo_parts
from .load import read_entries as read_entries
from .load import read_toml as read_toml
from .provenance import assumptions as assumptions
from .provenance import changes as changes
from .provenance import unchanged as unchanged
