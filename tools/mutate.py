"""The mutation check: would the tests notice a wrong sign in the physics?

    python tools/mutate.py [--list] [--sample N] [--jobs N] [FILE ...]

One at a time, in a copy of the package: + becomes - and back, the first term of a sum is negated, a unary
minus is dropped, a comparison is turned round, a returned value is negated; and in the C of the engine,
which is compiled again (see `mutate_c`). Then the tests of that file run. A change
that no test notices is a survivor: it is printed, and the exit status 1.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from multiprocessing.connection import wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Any, NamedTuple

import mutate_c

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "stickslip"


# The share of a sample that tests notice, at least: it shows that they bite. A run of all asks for each.
BITES = 0.9


class Target(NamedTuple):
    """Where physics stands, and the tests that guard it. No functions named: all of the module.

    The tests are those that evaluate an equation once and compare it with an independent one: seconds,
    where a simulation would take longer.
    """

    files: str
    tests: tuple[str, ...]
    functions: tuple[str, ...] = ()


LAWS = tuple(
    f"tests/friction/test_contract.py::{test}"
    for test in (
        "test_compiled_law_agrees_with_plain_python_and_with_the_oracle",
        "test_static_law_has_no_state_and_true_rest",
        "test_bound_of_the_state_is_kept_and_changes_nothing_inside",
    )
)
MOTION = ("tests/physics/test_mechanism.py",)
BRANCHES = (*LAWS, "tests/friction/test_branches.py")
CHARGING = ("tests/physics/electronics/test_charging.py", "tests/physics/electronics/test_driven.py")
HALF_SPACE = ("tests/physics/contact/test_half_space.py",)
CONTACT = "tests/physics/contact/test_asperities.py::test_"
DESIGN = ("tests/design/test_equations.py",)
DESIGN_FILE = "tests/jobs/analysis/test_design_file.py::test_"
VIBRATION = tuple(
    f"tests/design/test_vibration.py::{test}"
    for test in (
        "test_harmonics_are_those_of_the_stage_integrated_in_time",
        "test_tension_at_the_tip_is_what_pulls_the_mass_back",
        "test_tension_of_slow_and_fast_drives_at_any_damping",
        "test_sound_of_a_slow_drive",
        "test_what_is_heard_is_weighted_as_the_standard_says",
    )
)
LEARNT = "tests/control/test_learned.py::test_"
# The same equations in C.
IN_EXPORT = ("tests/export/test_stage.py::test_stops_feel_the_stage_as_in_the_solver",)
MOVER = (
    "tests/control/test_moving.py::test_a_table_between_its_points_at_them_and_beyond",
    "tests/control/test_moves_stored.py::test_a_move_is_as_stored",
)
ENGINE = (
    "tests/engine/test_trajectories.py::test_as_stored",
    "tests/engine/test_trajectories.py::test_goes_on_to_the_last_bit",
    "tests/engine/test_trajectories.py::test_gives_up_after_so_many_steps",
    "tests/engine/test_limits.py",
)
NEAR = "tests/engine/test_near.py::test_as_stored"
COPIES, EQUATIONS = "tests/engine/test_copies.py", "tests/engine/test_equations.py"
ORBIT, TABLES = (
    "tests/engine/test_orbits.py::test_a_period_from_the_orbit_leads_back_to_it",
    "tests/engine/test_tables.py",
)
ORBITS_OF_MAPS = "tests/engine/test_orbits_of_maps.py"
AT_PIEZO = "tests/simulation/plant/test_at_piezo.py::test_"
PLAYS = (
    "tests/physics/piezo/test_prandtl_ishlinskii.py",
    *(
        f"{AT_PIEZO}{test}"
        for test in (
            "table_is_what_samples_are",
            "a_jump_takes_plays_along_at_once",
            "a_cubic_segment_turns_where_its_slope_is_zero",
        )
    ),
)
DUHEM = ("tests/physics/piezo/test_bouc_wen.py", "tests/physics/piezo/test_duhem.py")
TURNS = "tests/simulation/solve/test_energy.py::test_a_static_stage_moves_the_end_effector_by_friction_alone"
STARVED = "tests/physics/electronics/test_driven.py::test_against_small_steps"
CHARGED = ("tests/physics/electronics/test_charging.py", STARVED)
# The first row that fits a file counts.
TARGETS = (
    Target("friction/law.py", LAWS, ("force",)),
    Target("friction/maxwell_slip.py", BRANCHES),
    Target("friction/reset_integrator.py", BRANCHES),
    Target("friction/normal_force.py", ("tests/friction/test_normal_force.py",)),
    Target("friction/fields_read.py", ("tests/friction/test_law.py",)),
    Target("friction/*.py", LAWS),
    Target("simulation/models.py", MOTION, ("mechanism", "system", "resting_state", "_resting", "_held")),
    Target(
        "physics/piezo/bouc_wen.py",
        ("tests/physics/piezo/test_bouc_wen.py", "tests/physics/piezo/test_duhem.py"),
    ),
    Target(
        "physics/piezo/duhem.py",
        ("tests/physics/piezo/test_duhem.py",),
        ("rested", "output"),
    ),
    Target(
        "physics/piezo/*.py",
        ("tests/physics/piezo/test_prandtl_ishlinskii.py", "tests/physics/piezo/test_creep.py"),
    ),
    Target(
        "simulation/plant/splitting.py", ("tests/simulation/plant/test_at_piezo.py",), ("_table", "_repeated")
    ),
    Target(
        "simulation/plant/duhem_drive.py",
        ("tests/physics/piezo/test_bouc_wen.py", "tests/physics/piezo/test_duhem.py"),
        ("duhem_drive",),  # the others tell its precision
    ),
    Target("identify/walk/joint.py", ("tests/identify/walk/test_joint.py",)),
    Target(
        "simulation/two_port.py",
        ("tests/simulation/test_two_port_at_rest.py",),
        ("element_of", "settle", "_across"),
    ),
    Target(
        "simulation/plant/creeping.py",
        (
            "tests/simulation/plant/test_creeping.py",
            "tests/simulation/plant/test_at_piezo.py",
            "tests/simulation/plant/test_transformers.py::test_creep",
        ),
    ),
    Target(
        "simulation/plant/cubics.py",
        ("tests/simulation/plant/test_at_piezo.py",),
        ("with_cubics", "moved_on"),
    ),
    Target("export/piezo.py", IN_EXPORT, ("felt",)),
    Target("physics/electronics/charging.py", CHARGING, ("_remembered", "_mean_square", "_until_as_fast")),
    Target(
        "physics/electronics/amplifier.py",
        (*CHARGING, "tests/physics/electronics/test_amplifier.py"),
        ("limits",),
    ),
    Target(
        "physics/electronics/stack.py",
        ("tests/physics/electronics/test_account.py",),
        ("cycle_loss", "_above"),
    ),
    Target(
        "physics/contact/hertz.py",
        HALF_SPACE,
        ("contact_radius", "approach", "peak_pressure", "normal_stiffness"),
    ),
    Target(
        "physics/contact/mindlin.py",
        (*HALF_SPACE, f"{CONTACT}mindlins_loop_closes"),
        ("displacement", "force", "stick_radius", "loop", "loss", "tangential_stiffness"),
    ),
    Target("physics/contact/partial_slip.py", HALF_SPACE, ("backbone", "force", "tangential_stiffness")),
    Target(
        "physics/contact/material.py",
        (f"{CONTACT}two_bodies",),
        ("shear_modulus", "contact_modulus", "tangential_modulus", "dundurs"),
    ),
    Target("estimate/influence.py", ("tests/estimate/test_influence.py",), ("prior_influence", "_deviation")),
    Target(
        "physics/contact/persson.py", ("tests/physics/contact/test_roughness.py",), ("real_area", "holds")
    ),
    Target(
        "physics/contact/roughness.py",
        ("tests/physics/contact/test_roughness.py",),
        ("self_affine", "with_other"),
    ),
    Target(
        "physics/contact/asperities.py",
        (f"{CONTACT}moments", f"{CONTACT}stiffness_over_load", f"{CONTACT}scatter_from_place_to_place"),
        ("moment", "load", "real_area", "normal_stiffness", "stiffness_scatter", "area_scatter"),
    ),
    Target(
        "physics/contact/adhesion.py",
        (f"{CONTACT}adhesion",),
        ("tabor", "softness", "pull_off", "contact_radius"),
    ),
    Target(
        "physics/contact/iwan.py", (f"{CONTACT}iwan", f"{CONTACT}a_backbone"), ("maxwell_slip", "of_backbone")
    ),
    Target("physics/contact/ageing.py", (f"{CONTACT}time_and_wear",), ("stiction_ratio",)),
    Target("physics/contact/wear.py", (f"{CONTACT}time_and_wear",), ("force", "worn_depth")),
    Target("physics/contact/preload.py", (f"{CONTACT}preload",), ("normal_force", "along")),
    Target(
        "physics/contact/comparing.py", ("tests/physics/contact/test_comparing.py",), ("_fitted", "_holm")
    ),
    Target("physics/actuator.py", ("tests/physics/test_actuator.py",), ("axial_force", "from_parts")),
    Target(
        "design/information.py",
        ("tests/design/test_choice.py",),
        ("covariance", "untold", "_directions", "plus", "times"),
    ),
    Target(
        "design/vibration.py",
        VIBRATION,
        ("acceleration", "least_acceleration", "audible", "a_weighting", "of"),
    ),
    Target("design/goals.py", DESIGN, ("of", "sign", "_check")),
    Target(
        "design/polygons.py",
        DESIGN,
        ("slopes", "_sides", "within", "knots", "as_knots", "starts", "sawtooths"),
    ),
    Target("design/search.py", DESIGN, ("score",)),
    Target(
        "jobs/analysis/design_given.py",
        (f"{DESIGN_FILE}draws_of_a_campaign_have_its_errors_and_correlations",),
        ("_drawn",),
    ),
    Target("simulation/demand.py", DESIGN, ("electrical_demand", "_of_one_period")),
    Target("design/tables.py", DESIGN, ("step_at", "voltage_for", "_direction")),
    Target(
        "design/front.py", ("tests/design/test_conditions.py::test_what_stays_of_a_front",), ("unbeaten",)
    ),
    Target(
        "control/learned.py",
        (
            f"{LEARNT}each_frequency_falls_by_its_own_contraction",
            f"{LEARNT}the_filter_has_no_phase",
            f"{LEARNT}it_diverges_where_the_bound_is_above_one",
        ),
        ("contraction", "_binomial"),
    ),
    Target("control/moving.py", MOVER, ("_numbers", "step")),
    Target(
        "control/relay.py",
        ("tests/control/test_relay.py::test_on_a_linear_loop_it_is_where_the_describing_function_says",),
        ("found", "pid"),
    ),
    Target("design/choice.py", ("tests/design/test_choice.py",), ("criterion", "score", "together")),
    Target("engine/c/members.c", ("tests/engine/test_members.py",)),
    Target("engine/c/engine.h", ("tests/engine/test_members.py", "tests/engine/test_limits.py")),
    Target(
        "engine/c/orbits.c", ("tests/engine/test_orbits.py", ORBITS_OF_MAPS, "tests/engine/test_limits.py")
    ),
    Target("engine/c/linear.h", ("tests/engine/test_linear.py",)),
    Target("engine/c/near.inl", (NEAR,)),
    Target("engine/c/periods.inl", (*ENGINE, NEAR, COPIES, ORBIT, EQUATIONS)),
    Target("engine/c/reading.inl", (*ENGINE, COPIES)),
    Target("engine/c/run.inl", (*ENGINE, COPIES, NEAR, TURNS)),
    Target("engine/c/kinematics.inl", (*ENGINE, NEAR, EQUATIONS)),
    Target("engine/c/table.h", (TABLES, *ENGINE)),
    Target("engine/c/repeats.h", ("tests/engine/test_repeats.py",)),
    Target("engine/c/plays.*", PLAYS),
    Target(
        "engine/c/creep.c",
        ("tests/physics/piezo/test_creep.py", f"{AT_PIEZO}creep_of_a_table_is_that_of_samples"),
    ),
    Target("engine/c/cubics.h", (f"{AT_PIEZO}creep_of_a_table_is_that_of_samples",)),
    Target("engine/c/duhem.c", DUHEM),
    Target("engine/c/ways.h", ("tests/physics/piezo/test_ways.py", *PLAYS, *DUHEM)),
    Target("engine/c/charging.c", CHARGED),
    Target("engine/c/arrival.h", (*MOVER, "tests/control/test_arrival.py")),
    Target("engine/c/mover.h", MOVER),
    Target("engine/c/motion.c", ("tests/engine/test_motion.py", "tests/engine/test_limits.py")),
    *(
        Target(f"engine/c/{files}", (*ENGINE, NEAR))
        for files in ("*.inl", "compose.h", "contact.h", "log.h", "reversal.h", "rodas5p.h")
    ),
    Target("rig/table.py", ("tests/rig/test_table.py",)),
    Target(
        "rig/devices/scpi/oscilloscopes.py",
        ("tests/rig/test_table.py",),
        ("_keysight", "_rigol", "_tektronix"),
    ),
)

# A change can make a loop endless; that is noticed too, after this many times what the tests take without it.
PATIENCE, AT_LEAST = 4.0, 15.0
PRELOADED = ("hypothesis", "pint", "pytest", "scipy.integrate", "scipy.optimize", "xarray")
WRONG_COPY = 97
OBJECTS = "objects"  # of the unchanged engine

OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.USub: ast.UAdd,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


class Mutant(NamedTuple):
    """One change: the file inside the package, its line, what was changed into what, and the new source."""

    file: str
    line: int
    change: str
    source: str
    tests: tuple[str, ...]


def negated(value: ast.expr) -> Iterator[ast.expr]:
    """The value with its sign changed; of a tuple, each element in turn."""
    if isinstance(value, ast.Tuple):
        for i, element in enumerate(value.elts):
            for other in negated(element):
                yield ast.Tuple(elts=[*value.elts[:i], other, *value.elts[i + 1 :]], ctx=ast.Load())
    elif isinstance(value, ast.Constant) and value.value in (0, None):
        return
    # Of -x, the minus is dropped elsewhere; what is true stays true with a minus.
    elif not isinstance(value, ast.UnaryOp | ast.Lambda | ast.BoolOp | ast.Compare):
        yield ast.UnaryOp(op=ast.USub(), operand=value)


def is_sum(node: ast.AST) -> bool:
    """Whether the node is a + b or a - b."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def changes(node: ast.AST) -> Iterator[tuple[str, object]]:
    """The changes to one node of the syntax tree: a field and its new content."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.UnaryOp) and type(node.op) in OPPOSITE:
        yield "op", OPPOSITE[type(node.op)]()
    if isinstance(node, ast.BinOp) and is_sum(node) and not is_sum(node.left):
        for first in negated(node.left):
            yield "left", first
    if isinstance(node, ast.Compare):
        for i, operator in enumerate(node.ops):
            if type(operator) in OPPOSITE:
                yield "ops", [*node.ops[:i], OPPOSITE[type(operator)](), *node.ops[i + 1 :]]
    if isinstance(node, ast.Return) and node.value is not None:
        for value in negated(node.value):
            yield "value", value


def inside(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """The nodes of a function, but for its docstring."""
    for statement in function.body[1 if ast.get_docstring(function) else 0 :]:
        yield from ast.walk(statement)


def mutants(file: Path, target: Target) -> Iterator[Mutant]:
    """Every mutant of a file's target functions."""
    name = file.relative_to(PACKAGE).as_posix()
    if file.suffix != ".py":
        for change in mutate_c.changes(file.read_text(), file.name):
            yield Mutant(name, *change, target.tests)
        return
    tree = ast.parse(file.read_text())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    missing = set(target.functions) - {function.name for function in functions}
    if missing:
        sys.exit(f"mutate: {name} has no {', '.join(missing)}: correct TARGETS")
    for function in functions:
        if not (function.name in target.functions if target.functions else function in tree.body):
            continue
        for node in inside(function):
            for field, new in changes(node):
                old, before = getattr(node, field), ast.unparse(node)
                setattr(node, field, new)
                change = f"{before} -> {ast.unparse(node)}"
                yield Mutant(name, getattr(node, "lineno", 0), change, ast.unparse(tree), target.tests)
                setattr(node, field, old)


def all_mutants(only: Sequence[str]) -> list[Mutant]:
    """The mutants of all targets, or of the files named."""
    found: dict[Path, list[Mutant]] = {}
    for target in TARGETS:
        files = sorted(PACKAGE.glob(target.files))
        if not files:
            sys.exit(f"mutate: there is no {target.files}: correct TARGETS")
        own = [file for file in files if file not in found]
        for file in own:
            path = file.relative_to(PACKAGE).as_posix()
            found[file] = (
                [] if only and all(name not in path for name in only) else list(mutants(file, target))
            )
        if not only and not any(found[file] for file in own):
            sys.exit(f"mutate: {target.files} has nothing to change: correct TARGETS")
    return [mutant for group in found.values() for mutant in group]


def run_tests(copy: Path, mutant: Mutant, objects: Path) -> None:
    """In a process of its own: run the tests over the copy of the package and exit with pytest's status."""
    import pytest

    with (copy / "output.txt").open("w") as output:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    file = copy / "stickslip" / mutant.file
    if file.suffix != ".py":
        mutate_c.build(file.parent, file.name, objects)
    os.chdir(ROOT)
    os.environ["PYTHONPATH"] = str(copy)
    sys.path.insert(0, str(copy))
    durations: dict[str, float] = {}
    options = ["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:unraisableexception"]
    status = int(pytest.main([*options, *mutant.tests], plugins=[Durations(durations)]))
    (copy / "durations.json").write_text(json.dumps(durations))
    tested = importlib.import_module("stickslip").__file__ or ""
    sys.stdout.flush()
    os._exit(status if tested.startswith(str(copy)) else WRONG_COPY)


class Durations:
    """A plugin of pytest that adds up the seconds of each test."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self.seconds = seconds

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add a phase of a test."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


class Run(NamedTuple):
    """A process that tests a copy of the package, changed or not."""

    process: ForkProcess
    copy: Path
    started: float
    mutant: Mutant


def start(folder: Path, mutant: Mutant) -> Run:
    """Copy the package, change it, and start its tests."""
    copy = Path(tempfile.mkdtemp(dir=folder))
    shutil.copytree(PACKAGE, copy / "stickslip", ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "stickslip" / mutant.file).write_text(mutant.source)
    arguments = (copy, mutant, folder / OBJECTS)
    process = multiprocessing.get_context("fork").Process(target=run_tests, args=arguments)
    process.start()
    return Run(process, copy, time.monotonic(), mutant)


def check_unchanged(folder: Path, queue: list[Mutant]) -> dict[tuple[str, ...], float]:
    """The tests must pass over an unchanged copy, or every mutant would seem to be noticed.

    Returns how long those of a mutant may take, s.
    """
    every = tuple(sorted({test for mutant in queue for test in mutant.tests}))
    run = start(folder, Mutant("__init__.py", 0, "", (PACKAGE / "__init__.py").read_text(), every))
    run.process.join()
    if run.process.exitcode != 0:
        print((run.copy / "output.txt").read_text())
        sys.exit(f"mutate: tests fail without any change (status {run.process.exitcode})")
    took: dict[str, float] = json.loads((run.copy / "durations.json").read_text())
    seconds = {}
    for tests in {mutant.tests for mutant in queue}:
        own = sum(took[test] for test in took if test.startswith(tests))
        seconds[tests] = AT_LEAST + PATIENCE * own
    return seconds


def survivors(
    folder: Path, queue: list[Mutant], jobs: int, seconds: dict[tuple[str, ...], float]
) -> Iterator[Mutant]:
    """Run the tests on every mutant, `jobs` at a time, and yield those that passed."""
    running: list[Run] = []
    waiting = list(reversed(queue))
    while waiting or running:
        while waiting and len(running) < jobs:
            running.append(start(folder, waiting.pop()))
        wait([run.process.sentinel for run in running], timeout=1.0)
        for run in list(running):
            if run.process.is_alive():
                if time.monotonic() - run.started > seconds[run.mutant.tests]:
                    run.process.kill()
                continue
            running.remove(run)
            if run.process.exitcode == WRONG_COPY:
                sys.exit("mutate: the tests did not import the changed copy")
            if run.process.exitcode == 0:
                yield run.mutant
            shutil.rmtree(run.copy)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", help="only files whose path in the package contains this")
    parser.add_argument("--list", action="store_true", help="print the mutants and run nothing")
    parser.add_argument("--sample", type=int, metavar="N", help="only so many, others each time")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    queue = all_mutants(arguments.files)
    if arguments.sample is not None:
        queue = random.sample(queue, min(arguments.sample, len(queue)))
    if arguments.list:
        for mutant in queue:
            print(f"{mutant.file}:{mutant.line}: {mutant.change}")
        return

    began = time.monotonic()
    os.environ |= {
        "CI": "true",
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    for module in PRELOADED:  # once, here, and not in each of a hundred processes
        importlib.import_module(module)
    missed: list[Mutant] = []
    with tempfile.TemporaryDirectory() as folder:
        if any(not mutant.file.endswith(".py") for mutant in queue):
            mutate_c.objects(PACKAGE / "engine" / "c", Path(folder) / OBJECTS)
        seconds = check_unchanged(Path(folder), queue)
        for mutant in survivors(Path(folder), queue, arguments.jobs, seconds):
            missed.append(mutant)
            print(f"survived: src/stickslip/{mutant.file}:{mutant.line}: {mutant.change}", flush=True)
    took = time.monotonic() - began
    count = len(queue)
    print(f"mutation: {count} wrong signs, {count - len(missed)} noticed, {len(missed)} not, in {took:.0f} s")
    allowed = int((1.0 - BITES) * count) if arguments.sample is not None else 0
    sys.exit(len(missed) > allowed)


if __name__ == "__main__":
    main()
