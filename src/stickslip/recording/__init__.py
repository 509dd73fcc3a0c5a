"""Recordings: one schema for measured and simulated data, in memory and on disk."""

from .exports import save_csv as save_csv
from .exports import save_matlab as save_matlab
from .schema import SCALE_UNCERTAINTY as SCALE_UNCERTAINTY
from .schema import SCHEMA_VERSION as SCHEMA_VERSION
from .schema import STANDARD_NAMES as STANDARD_NAMES
from .schema import RecordingError as RecordingError
from .schema import RecordingWarning as RecordingWarning
from .schema import Sampling as Sampling
from .schema import fits_name as fits_name
from .schema import make_recording as make_recording
from .schema import sampling as sampling
from .schema import validate_recording as validate_recording
from .storage import open_recording as open_recording
from .storage import save_recording as save_recording
