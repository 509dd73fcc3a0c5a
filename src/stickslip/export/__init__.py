"""Export of a model as code: portable C, and FMUs of it."""

from .mockup import export_fmu as export_fmu
from .portable import export_c as export_c
from .source import ExportError as ExportError
from .subset import TranslationError as TranslationError
