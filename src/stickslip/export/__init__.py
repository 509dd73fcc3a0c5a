"""Export of a model as code: portable C99, and functional mock-up units (FMUs) made from the same C."""

from ..engine.translator import TranslationError as TranslationError
from .mockup import export_fmu as export_fmu
from .portable import export_c as export_c
from .source import ExportError as ExportError
