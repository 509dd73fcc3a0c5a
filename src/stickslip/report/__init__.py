"""Reports: a document as plain data, written as one HTML file and one JSON file."""

from .document import Column as Column
from .document import Document as Document
from .document import DocumentError as DocumentError
from .document import Listing as Listing
from .document import Number as Number
from .document import Picture as Picture
from .document import Section as Section
from .document import Table as Table
from .pdf import PdfError as PdfError
from .pdf import find_browser as find_browser
from .pdf import write_pdf as write_pdf
from .writing import write_report as write_report
