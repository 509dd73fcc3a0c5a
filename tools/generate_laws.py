"""Write the C files of the engine that are made from the laws in Python (`make laws`)."""

from __future__ import annotations

from pathlib import Path

from stickslip.engine import laws

FOLDER = Path(laws.__file__).parent / "c"

if __name__ == "__main__":
    for name, text in laws.generated().items():
        (FOLDER / name).write_text(text, encoding="ascii")
