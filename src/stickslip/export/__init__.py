"""Export of a model as code: portable C, and FMUs of it."""

from ..engine.translator import TranslationError as TranslationError
from .mockup import export_fmu as export_fmu
from .portable import export_c as export_c
from .source import ExportError as ExportError
