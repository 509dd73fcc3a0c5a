"""Rules of the house that no linter knows. The layers are contracts of import-linter, in pyproject.toml."""

from __future__ import annotations

import ast
import itertools
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement

import stickslip

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "stickslip"
SOURCES = sorted(PACKAGE.rglob("*.py"))
ROOMS = {child.stem for child in PACKAGE.iterdir()}
TRACKED = subprocess.run(
    ["git", "ls-files", "--cached", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split("\0")[:-1]

LONGEST_FILE = 400
LARGEST_FILE = 500_000  # bytes
NO_NAMES = {"utils", "util", "core", "base", "manager", "helpers", "misc", "common"}
BUILT = {".pyc", ".so", ".o", ".coverage", ".egg-info", ".whl"}

# The rooms that may import a heavy dependency; everything else reaches it through them.
OWNERS = {
    "numba": {"engine/numba_laws"},
    "pint": {"quantities/units"},
    "pandas": {"recording/readers/csv", "recording/schema", "history/table", "study/exports"},
    "matplotlib": {"report/figures"},
    "jinja2": {"report"},
    "pooch": {"recording/datasets"},
    "threadpoolctl": {"estimate"},
    "arviz": {"estimate/posterior"},
    "pydantic": {"quantities/arguments", "quantities/input_file", "jobs", "rig/experiment", "panel"},
    "yaml": {"quantities/input_file", "gate"},
    "pyvisa": {"rig/scpi"},
    "asammdf": {"recording/readers/mdf"},
    "h5py": {"gate"},
    "h5netcdf": {"gate"},
    "typer": {"cli"},
    "fastapi": {"panel"},
    "dask": {"study"},
    "distributed": {"study/cluster"},
    "zarr": {"study"},
    "pyarrow": {"study/exports"},
}
# What `import stickslip` must leave alone: it is the first line of every script.
HEAVY = ["numba", "scipy", "xarray", "pandas", "matplotlib", "pint", "h5py", "h5netcdf", "typer", "pydantic"]
HEAVY += ["jinja2", "dask", "distributed", "zarr", "fastapi", "arviz"]


def room(file: Path) -> str:
    """The module's path inside the package, without the ending: "rig/virtual"."""
    return file.relative_to(PACKAGE).with_suffix("").as_posix()


def imports(file: Path) -> Iterator[str]:
    """Dotted names of all that a source file imports, anywhere in it; ".units.to_si" from the package."""
    folder = file.relative_to(PACKAGE).parent.parts
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = ["", *folder[: len(folder) - node.level + 1]] if node.level else []
            module = [*above, *([node.module] if node.module else [])]
            yield from (".".join([*module, alias.name]) for alias in node.names)


def public_names() -> dict[str, str]:
    """Public name -> module, as the type stub of the package lists them."""
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
    return {
        alias.asname or alias.name: node.module or ""
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def broken_rules(file: Path) -> Iterator[str]:
    """What a source file does that no file may."""
    names = list(imports(file))
    if (lines := len(file.read_text().splitlines())) > LONGEST_FILE:
        yield f"{lines} lines, more than {LONGEST_FILE}"
    if wrong := set(room(file).split("/")) & NO_NAMES:
        yield f"{wrong} says nothing about what is inside"
    if wrong := [name for name in names if name.endswith("*")]:
        yield f"a star import hides where names come from: {wrong}"
    if wrong := [name for name in names if name.split(".")[0] == "stickslip"]:
        yield f"imports inside are relative: {wrong}"
    if wrong := {name.split(".")[1] for name in names if name.startswith(".")} - ROOMS:
        yield f"the root is for users: {wrong}"
    if wrong := [name for name in names if name.startswith("scipy.") and name.count(".") > 1]:
        yield f"0.1 to 0.4 s for every command: after `import scipy`, scipy.{{...}} loads when used: {wrong}"
    for dependency in {name.split(".")[0] for name in names} & OWNERS.keys():
        if not any(f"{room(file)}/".startswith(f"{owner}/") for owner in OWNERS[dependency]):
            yield f"{dependency} is for {OWNERS[dependency]}"


def test_every_source_file_keeps_the_rules() -> None:
    assert not [f"{room(file)}: {rule}" for file in SOURCES for rule in broken_rules(file)]


def test_a_file_that_breaks_every_rule_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    (file := tmp_path / "utils.py").write_text(
        "from numpy import *\nimport stickslip, zarr\nfrom . import x\n"
        "from scipy.optimize import root\n" + "\n" * LONGEST_FILE
    )
    assert len(list(broken_rules(file))) == 7


def test_files_of_data_are_opened_by_the_gate() -> None:
    """HDF5 may name other files, an archive hold a million arrays: what opens them checks them first."""
    opener = re.compile(
        r"\b(open_(dataset|dataarray|datatree|mfdataset|groups)|load_(dataset|dataarray)|np\.load)\("
    )
    outside = [file for file in SOURCES if not room(file).startswith("gate/")]
    assert not [room(file) for file in outside if opener.search(file.read_text())]
    assert opener.search("xr.open_dataset(path)")


def test_import_is_light() -> None:
    program = f"import sys, stickslip; print([name for name in {HEAVY} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_every_public_name_is_documented() -> None:
    for name in public_names():
        value = getattr(stickslip, name)
        assert name in dir(stickslip)
        if callable(value):
            documentation = value.__doc__ or ""
            assert len(documentation.split()) >= 4, f"{name}: say what it is, in units"
            assert not documentation.startswith(f"{name}("), "a named tuple's own docstring says nothing"


def test_no_module_hides_a_public_function() -> None:
    modules = {file.stem for file in PACKAGE.iterdir() if file.is_dir() or file.suffix == ".py"}
    rooms = {name for name in public_names() if isinstance(getattr(stickslip, name), ModuleType)}
    assert not modules & (public_names().keys() - rooms)


def test_nothing_large_or_built_is_committed() -> None:
    tracked = [ROOT / name for name in TRACKED if (ROOT / name).exists()]
    assert tracked
    assert not [file for file in tracked if file.stat().st_size > LARGEST_FILE], (
        "data are fetched, not committed"
    )
    assert not [file for file in tracked if file.suffix in BUILT or "__pycache__" in file.parts]


def test_lock_file_holds_what_the_project_asks_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *itertools.chain(*extras.values())]
    lock = (ROOT / "requirements.lock").read_text()
    locked = dict(re.findall(r"^([a-z0-9-]+)==(\S+)", lock, flags=re.MULTILINE))
    for requirement in map(Requirement, asked):
        if requirement.name != "stickslip":
            assert requirement.specifier.contains(locked[requirement.name]), f"{requirement}: make lock"
    assert "://" not in lock, "an index or a path of somebody's machine"


def test_every_test_runs() -> None:
    idle = {"skip", "skipif", "xfail", "importorskip"}
    for file in sorted((ROOT / "tests").rglob("*.py")):
        if re.search(rf"\.({'|'.join(idle)})\b", text := file.read_text()):
            names = {node.attr for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)}
            assert not names & idle, file.name


@pytest.mark.parametrize(
    ("missing", "name"),
    [("matplotlib", "plot"), ("pydantic", "jobs.campaign"), ("anywidget", "panel.plot_widget")],
)
def test_a_missing_extra_is_named(missing: str, name: str) -> None:
    program = f"import sys; sys.modules[{missing!r}] = None; import stickslip; stickslip.{name}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert f"stickslip.{name} needs {missing}, which is not installed" in result.stderr
    assert 'pip install "stickslip[all]"' in result.stderr
