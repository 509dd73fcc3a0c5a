"""Wheel and source distribution: whole, with all licences, and usable without the checkout."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest
import yaml

import stickslip
from stickslip.engine.library import FILE

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
NAME = f"stickslip-{stickslip.__version__}"
PACKAGE = subprocess.run(
    ["git", "ls-files", "-z", "src/stickslip"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split("\0")[:-1]
# Of others, with the words that their licence asks to keep.
VENDORED = {
    "panel/static/vendor/uplot.LICENSE": "The MIT License",
    "export/c/fmi/fmi2Functions.h": "Redistributions in binary form must reproduce",
    "export/c/fmi/fmi2FunctionTypes.h": "Redistributions in binary form must reproduce",
    "export/c/fmi/fmi2TypesPlatform.h": "Redistributions in binary form must reproduce",
    "export/c/fmi/fmi3Functions.h": "Redistributions in binary form must reproduce",
    "export/c/fmi/fmi3FunctionTypes.h": "Redistributions in binary form must reproduce",
    "export/c/fmi/fmi3PlatformTypes.h": "Redistributions in binary form must reproduce",
}


def build(source: Path, out: Path, kind: str) -> Path:
    out.mkdir(exist_ok=True)
    program = f"from scikit_build_core import build; build.build_{kind}({str(out)!r})"
    subprocess.run([sys.executable, "-c", program], cwd=source, capture_output=True, check=True, timeout=240)
    (made,) = out.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return made


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("sdist"), "sdist")


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the source distribution, which has to be enough for it."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(["tar", "-xf", str(sdist), "-C", str(folder)], check=True, timeout=120)
    return build(folder / NAME, folder / "dist", "wheel")


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment that holds the wheel alone; what it depends on is read from this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=os.name != "nt")
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    pip = [sys.executable, "-m", "pip", "--python", str(folder), "--disable-pip-version-check", "install"]
    subprocess.run(
        [*pip, "--quiet", "--no-index", "--no-deps", str(wheel)], check=True, capture_output=True, timeout=120
    )
    # A path in such a file is no place of further such files: the editable install of this one is not seen.
    (packages,) = folder.rglob("site-packages")
    (packages / "dependencies.pth").write_text(str(Path(pytest.__file__).parents[1]) + "\n", "utf-8")
    return programs


def test_the_wheel_holds_the_package_and_its_licences(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = message_from_bytes(archive.read(f"{NAME}.dist-info/METADATA"))
        found = {name: archive.read(f"stickslip/{name}").decode() for name in VENDORED}
    package = {name for name in names if name.startswith("stickslip/")}
    assert wheel.name.startswith(f"{NAME}-py3-none-"), "one for every Python, for one platform"
    assert not wheel.name.endswith("-any.whl")
    assert package == {*(name.removeprefix("src/") for name in PACKAGE), f"stickslip/engine/{FILE.name}"}
    assert all(name.startswith((f"{NAME}.dist-info/", "stickslip/")) for name in names)
    assert metadata["Version"] == stickslip.__version__
    assert metadata["License-Expression"] == "BSD-3-Clause"
    assert set(metadata.get_all("License-File", [])) == set(PROJECT["license-files"])
    for name in PROJECT["license-files"]:
        assert f"{NAME}.dist-info/licenses/{name}" in names
    for name, words in VENDORED.items():
        assert words in found[name]


def test_the_source_distribution_holds_what_is_needed_to_work_on_it(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        names = {name.removeprefix(f"{NAME}/") for name in archive.getnames()}
    assert {*PACKAGE, "LICENSE", "CHANGELOG.md", "CITATION.cff", "Makefile", "requirements.lock"} <= names
    assert "native/CMakeLists.txt" in names
    assert "tests/test_packaging.py" in names
    assert not any(re.search(r"(^|/)(\.venv|out|__pycache__)/|\.(pyc|so|dylib|dll)$", name) for name in names)


def test_all_that_is_vendored_is_listed() -> None:
    package = ROOT / "src" / "stickslip"
    vendor = {str(file.relative_to(package)) for file in package.glob("**/vendor/*.LICENSE")}
    for file in package.glob("**/vendor/*"):
        assert f"{file.relative_to(package).with_suffix('')}.LICENSE" in vendor
    by_others = {
        str(file.relative_to(package))
        for file in package.glob("export/c/**/*.h")
        if "Modelica Association" in file.read_text("utf-8")
    }
    assert vendor | by_others == set(VENDORED)


def test_the_wheel_works_without_the_checkout(installed: Path, tmp_path: Path) -> None:
    def run(*command: str) -> str:
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
        done = subprocess.run(
            [str(installed / command[0]), *command[1:]],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    law = "from stickslip.engine.library import packaged; print(packaged('law')['LuGre'].parameters)"
    assert run("python", "-c", law) == "7\n"
    where = run("python", "-c", "import stickslip; print(stickslip.__file__)")
    assert Path(where.strip()).is_relative_to(installed.parent)
    assert run("stickslip", "--version") == f"stickslip {stickslip.__version__}\n"
    run("stickslip", "simulate", "--waveform", "step", "--amplitude", "65 V", "--duration", "2 ms")
    assert (tmp_path / "out" / "simulate" / "report.html").is_file()


def test_version_changelog_citation_and_recipe_agree() -> None:
    version = stickslip.__version__
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["version"] == version
    assert json.loads((ROOT / ".zenodo.json").read_text("utf-8"))["version"] == version
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text("utf-8"))
    assert recipe["context"]["version"] == version
    (newest, *_) = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert newest == "Unreleased" if ".dev" in version else newest.startswith(f"[{version}]")
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["license"] == PROJECT["license"]


def test_every_python_that_is_named_is_the_same() -> None:
    (lowest,) = re.findall(r">=(\d+\.\d+)", PROJECT["requires-python"])
    public = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text("utf-8"))
    named = public["jobs"]["install"]["strategy"]["matrix"]["python"]
    assert min(named, key=lambda one: int(one.split(".")[1])) == lowest
    classified = [c.rsplit(" ", 1)[1] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert classified == named
    assert f"Python {lowest} or newer" in (ROOT / "README.md").read_text("utf-8")


def test_the_public_ci_runs_what_there_is() -> None:
    """Targets of the Makefile, files of tests: it has not been run, so a name could go stale."""
    said = (ROOT / ".github/workflows/ci.yml").read_text("utf-8")
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert set(re.findall(r"run: make (\w+)", said)) <= set(targets)
    named = re.findall(r"(?<= )tests/[\w/.]+", said + (ROOT / "Makefile").read_text("utf-8"))
    assert len(named) > 10
    for one in named:
        assert (ROOT / one).exists(), one
