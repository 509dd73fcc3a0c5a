"""Recognition of file formats that the package does not read, by their first bytes, with advice on how to get
their numbers.

Formats that the package reads have their own recognition (`source.Format`).
"""

from __future__ import annotations

import re
from typing import NamedTuple

_CSV = "save it as CSV in the program that wrote it"
_SHEET = "save its sheet as CSV"
_UNPACK = "unpack it, and read what is in it"
_PANDAS = 'in Python, pandas.{}(FILE).to_csv("FILE.csv", index=False) makes a table of it'
_PICKLE = "load it in Python where you trust it, and save its arrays by numpy.savez"
_TOPOGRAPHY = "read a topography by the extra stickslip[topography], or export the channel as text"
_NO_TABLE = "it holds no table of numbers: save the numbers behind it as CSV"
_EXCEL = "an Excel workbook"


class FileSignature(NamedTuple):
    """A format that is not read.

    Fields: `what`, its description; `begins`, a regular expression for the first bytes; `advice` for the
    user; `endings` of file names, one of which is also required if there are any.
    """

    what: str
    begins: bytes
    advice: str
    endings: tuple[str, ...] = ()


HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

# Signatures of formats of binary files.
BINARY = (
    FileSignature("packed by gzip", rb"\x1f\x8b", f"{_UNPACK}: gunzip FILE"),
    FileSignature("packed by bzip2", rb"BZh[1-9]1AY&SY", f"{_UNPACK}: bunzip2 FILE"),
    FileSignature("packed by xz", rb"\xfd7zXZ\x00", f"{_UNPACK}: unxz FILE"),
    FileSignature("packed by Zstandard", rb"\x28\xb5\x2f\xfd", f"{_UNPACK}: unzstd FILE"),
    FileSignature("packed by LZ4", rb"\x04\x22\x4d\x18", f"{_UNPACK}: unlz4 FILE"),
    FileSignature("a 7z archive", rb"7z\xbc\xaf\x27\x1c", _UNPACK),
    FileSignature("a RAR archive", rb"Rar!\x1a\x07", _UNPACK),
    FileSignature("a tar archive", rb".{257}ustar", f"{_UNPACK}: tar xf FILE"),
    FileSignature(_EXCEL, rb"PK\x03\x04.*?xl/", _SHEET),
    FileSignature(_EXCEL, rb"PK\x03\x04", _SHEET, (".xlsx", ".xlsm", ".xlsb")),
    FileSignature("an OpenDocument spreadsheet", rb"PK\x03\x04.{26}mimetypeapplication/vnd.oasis", _SHEET),
    FileSignature("a ZIP archive", rb"PK\x03\x04|PK\x05\x06", _UNPACK),
    FileSignature("an old Excel workbook", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", _SHEET, (".xls",)),
    FileSignature("in Microsoft's compound format", rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", _CSV),
    FileSignature("a Parquet table", rb"PAR1", _PANDAS.format("read_parquet")),
    FileSignature("a Feather or Arrow table", rb"ARROW1|FEA1", _PANDAS.format("read_feather")),
    FileSignature("an ORC table", rb"ORC", _PANDAS.format("read_orc")),
    FileSignature(
        "a database of SQLite",
        rb"SQLite format 3\x00",
        "export its table: sqlite3 -csv -header FILE 'select * from TABLE' > FILE.csv",
    ),
    FileSignature("a Python pickle", rb"\x80[\x02-\x05][\x95c}\]X(]", _PICKLE),
    FileSignature("a Python pickle", rb"\x80[\x02-\x05]|x\x9c", _PICKLE, (".pkl", ".pickle", ".joblib")),
    FileSignature(
        "a data file of R", rb"RD[AX][23]\n", 'in R, write.csv(TABLE, "FILE.csv") makes a table of it'
    ),
    FileSignature("a file of HDF 4", rb"\x0e\x03\x13\x01", "h4toh5 OLD NEW.h5 makes an HDF5 file of it"),
    FileSignature(
        "NetCDF 3 (classic)", rb"CDF[\x01\x02\x05]", "nccopy -k nc4 OLD.nc NEW.nc makes NetCDF 4 of it"
    ),
    FileSignature("the index of a TDMS file", rb"TDSh", "read the .tdms file beside it"),
    FileSignature("a project of Origin", rb"CPYU?A ", "export its worksheet as CSV"),
    FileSignature("a file of Igor Pro", rb"", "save its waves as delimited text", (".ibw", ".pxp")),
    FileSignature(
        "a file of DEWESoft", rb"", "export it as MAT or CSV in DEWESoft", (".dxd", ".d7d", ".dxz")
    ),
    FileSignature("a file of PicoScope", rb"", "in PicoScope: File, Save As, CSV or MATLAB", (".psdata",)),
    FileSignature(
        "a file of HBM", rb"", "export it as CSV or MAT in Catman or Perception", (".mea", ".pnrf")
    ),
    FileSignature("a file of Spike2", rb"", "export it as MAT or text in Spike2", (".smr", ".smrx")),
    FileSignature("a record of Yokogawa", rb"", _CSV, (".wdf", ".wvf")),
    FileSignature("a topography of Gwyddion", rb"GWY[PO]", _TOPOGRAPHY),
    FileSignature(
        "a sound file (WAV)",
        rb"RIFF.{4}WAVE",
        "scipy.io.wavfile.read(FILE) gives rate and samples in Python: save them by numpy.savez",
    ),
    FileSignature("a sound file", rb"fLaC|OggS|ID3", _CSV),
    FileSignature("a film", rb"RIFF.{4}AVI |.{4}ftyp", _NO_TABLE),
    FileSignature("a picture", rb"\x89PNG|\xff\xd8\xff|GIF8|BM.{4}\x00{4}|II\*\x00|MM\x00\*", _NO_TABLE),
    FileSignature("a program", rb"\x7fELF|MZ|\xca\xfe\xba\xbe", _NO_TABLE),
)
# Signatures of files that are text or start like text, but are not tables of numbers.
TEXTS = (
    FileSignature("a file of imc FAMOS", rb"\|CF,\d", "export it as CSV in FAMOS"),
    FileSignature(
        "an image of a scanning probe microscope",
        rb"\\\*(File|Force file|EC File) list|:NANONIS_VERSION:",
        _TOPOGRAPHY,
    ),
    FileSignature("a PDF", rb"%PDF-", "save the table in it as CSV"),
    FileSignature("a document", rb"\{\\rtf|%!PS", "save the table in it as CSV"),
    FileSignature(
        "a web page",
        rb"(?i)\s*<(!doctype html|html)",
        "the download gave a page instead of the file; download the file itself ('raw')",
    ),
    FileSignature("an Excel workbook as XML", rb"\s*<\?xml.{0,999}?<Workbook", _SHEET),
    FileSignature("in XML", rb"\s*<(\?xml|svg)", _CSV),
    FileSignature("a pointer of Git LFS", rb"version https://git-lfs", "git lfs pull brings the file itself"),
    FileSignature("in JSON", rb'\s*(\{\s*"|\[\s*[\[{])', _PANDAS.format("read_json")),
)

_COMPILED = [
    [(one, re.compile(one.begins, re.DOTALL)) for one in table] for table in (TEXTS, (*TEXTS, *BINARY))
]
# Control characters that texts do not contain: all except tabs, ends of lines, pages and files, and escapes.
_CONTROLS = bytes(sorted(set(range(32)) - set(b"\t\n\v\f\r\x1a\x1b")))
# largest share of control characters in the first bytes of a text; random bytes have 10 %
_MOST_CONTROLS = 0.003
_SHOWN = 8  # number of first bytes of an unknown file that a message shows


def is_text(head: bytes) -> bool:
    """Return True if the first bytes of a file are text: with the byte order mark of UTF-16, or without zero
    bytes and with few control characters."""
    # UTF-16 text, which has zero bytes, starts with a byte order mark.
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    controls = len(head) - len(head.translate(None, _CONTROLS))
    return b"\0" not in head and controls <= _MOST_CONTROLS * len(head)


def known_format(head: bytes, ending: str) -> FileSignature | None:
    """Return the `FileSignature` of a file with these first bytes and this ending of its name (".xls"), which
    is not read; None for other files."""
    for one, begins in _COMPILED[not is_text(head)]:
        if (not one.endings or ending in one.endings) and begins.match(head):
            return one
    return None


def not_read(head: bytes, ending: str, known: str) -> str:
    """Return the message for a file that is not read: its format with advice or, if the format is unknown,
    its first bytes and the formats that are read (`known`, a text)."""
    found = known_format(head, ending)
    if found is not None:
        return f"it is {found.what}, and is not read so: {found.advice}"
    begins = head[:_SHOWN].hex(" ")
    return f"the content is neither text nor {known} (its first bytes are {begins}): {_CSV}"
