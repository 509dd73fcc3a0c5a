"""sitemap.xml of the pages, where the address at which they are hosted is known (`html_baseurl`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

_NAMESPACE = "http://www.sitemaps.org/schemas/sitemap/0.9"


def _write(app: Any, error: Exception | None) -> None:
    address = app.config.html_baseurl
    if error is not None or not address or app.builder.name != "html":
        return
    top = ElementTree.Element("urlset", xmlns=_NAMESPACE)
    for page in sorted(app.env.found_docs):
        where = f"{address.rstrip('/')}/{app.builder.get_target_uri(page)}"
        ElementTree.SubElement(ElementTree.SubElement(top, "url"), "loc").text = where
    ElementTree.indent(top)
    file = Path(app.outdir) / "sitemap.xml"
    ElementTree.ElementTree(top).write(file, encoding="utf-8", xml_declaration=True)


def setup(app: Any) -> dict[str, bool]:
    """As Sphinx asks for."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
