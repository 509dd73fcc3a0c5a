"""The documentation as a site with one folder for each version: `python -m tools.site out/site URL`.

Folders of other versions stay. The first page leads to the newest release, or to "dev" before there is one.
"""

from __future__ import annotations

import html
import re
import shutil
import subprocess
import sys
from pathlib import Path

from stickslip import __version__

ROOT = Path(__file__).resolve().parents[1]
DEV = "dev"
_RELEASE = re.compile(r"\d+\.\d+\.\d+")


def folder_of(version: str) -> str:
    """Return the folder of a version: that of all versions before a release is "dev"."""
    return version if _RELEASE.fullmatch(version) else DEV


def newest(folders: list[str]) -> str:
    """Return the newest release, or "dev"."""
    releases = [name for name in folders if _RELEASE.fullmatch(name)]
    return max(releases, key=lambda name: tuple(map(int, name.split("."))), default=DEV)


def write_top(site: Path, url: str) -> None:
    """Write the first page, which leads to the newest version and lists all, and the sitemap's place."""
    folders = sorted(path.parent.name for path in site.glob("*/index.html"))
    first = newest(folders)
    links = "\n".join(f'<li><a href="{name}/index.html">{html.escape(name)}</a></li>' for name in folders)
    (site / "index.html").write_text(
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>stickslip: versions</title>\n'
        f'<meta http-equiv="refresh" content="0; url={first}/index.html"></head>\n'
        f"<body><h1>stickslip</h1><p>Versions of the documentation:</p><ul>\n{links}\n</ul></body></html>\n",
        encoding="utf-8",
    )
    sitemap = f"User-agent: *\nAllow: /\nSitemap: {url.rstrip('/')}/{first}/sitemap.xml\n"
    (site / "robots.txt").write_text(sitemap, encoding="utf-8")
    (site / ".nojekyll").touch()  # GitHub Pages would leave out folders that start with "_"


def main(site: Path, url: str, *options: str) -> None:
    """Build this version into its folder; `options` are Sphinx's."""
    name = folder_of(__version__)
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", *options]
    address = ["-D", f"html_baseurl={url.rstrip('/')}/{name}/"]
    trees = ["-d", str(site.resolve().parent / "doctrees")]
    subprocess.run([*command, *address, *trees, str(ROOT / "docs"), str(site / name)], check=True)
    shutil.rmtree(site / "jupyter_execute", ignore_errors=True)  # what MyST-NB leaves beside the pages
    write_top(site, url)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
