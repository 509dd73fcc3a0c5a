"""Translator of Python functions of numbers and records to C99; the module `subset` says what can be
translated."""

from .subset import BOOL as BOOL
from .subset import INT as INT
from .subset import KEYWORDS as KEYWORDS
from .subset import REAL as REAL
from .subset import Array as Array
from .subset import Pair as Pair
from .subset import Record as Record
from .subset import TranslationError as TranslationError
from .subset import real as real
from .subset import record_type as record_type
from .translation import Translation as Translation
