"""Pages of devices, copied from their folders in the package before Sphinx reads."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from stickslip.rig import devices

_LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")
_PAGE = re.compile(r"\((?:\.\./)+src/stickslip/rig/devices/(\w+)/README\.md")


def write(app: Any) -> None:
    """Write the pages into docs/devices; a link to a file is changed to lead there from this folder."""
    folder = Path(app.srcdir) / "devices"
    for page in (page for place in devices.__path__ for page in Path(place).glob("*/README.md")):

        def moved(link: re.Match[str], source: Path = page.parent) -> str:
            return f"]({os.path.relpath(source / link[1], folder)}"

        text = _LINK.sub(moved, page.read_text(encoding="utf-8"))
        (folder / f"{page.parent.name}.md").write_text(text, encoding="utf-8")


def linked(app: Any, name: str, source: list[str]) -> None:
    """Change links to a README.md of a device's folder into links to its copy."""
    source[0] = _PAGE.sub(r"(/devices/\1.md", source[0])


def setup(app: Any) -> dict[str, bool]:
    """Register this extension with Sphinx."""
    app.connect("builder-inited", write)
    app.connect("source-read", linked)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
