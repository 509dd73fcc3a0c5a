"""Export of a model as a functional mock-up unit (FMU) for co-simulation."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, get_args

from ..physics.actuator import Actuator
from ..physics.electronics import Amplifier, StrainGauge
from ..quantities.units import optional_si
from ..recording.chain import Chain
from ..simulation.jumps import STATIC_JUMPS, cannot_jump
from .description import build_description, model_description, sources
from .portable import (
    C,
    checked_noise,
    checked_step,
    core_files,
    default_waveform,
    heading,
    signal_chain,
    write_files,
)
from .source import ExportError, exported
from .variables import Mode, variables, variables_h
from .writing import whole

_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h", "fmi3_missing.h"),
}
_BINARIES = {2: "linux64", 3: "x86_64-linux"}


def export_fmu(
    source: Any,
    out: str | os.PathLike[str],
    *,
    fmi: int = 2,
    mode: Mode = "plant",
    step: float | str = 20e-6,
    amplifier: Amplifier | None = None,
    piezo_capacitance: float | str | None = None,
    sensor: StrainGauge | None = None,
    chain: Chain | None = None,
    measurement_noise: float | str = 10e-9,
    compiler: str = "gcc",
) -> Path:
    """Write a model as an FMU for co-simulation, with sources and a binary for 64-bit Linux.

    Args:
        source, amplifier, piezo_capacitance, sensor, chain, measurement_noise: as for `export_c`.
        out: new folder for the file of the FMU, "MODEL_MODE.fmu" with the model's name and the mode.
        fmi: version of FMI, 2 or 3.
        mode: "plant" (drive voltage in, motion out), "observer" (drive voltage and measured position in,
            estimated motion out) or "feedforward" (wanted motion in, drive voltage out).
        step: longest internal step, s, a parameter of the FMU. For an observer, whose gain is valid for one
            step, the communication step.
        compiler: command that compiles the binary; "" leaves the binary out, and the importer compiles the
            sources.

    Returns:
        The path of the FMU.

    Raises:
        ExportError: the source cannot be exported in this mode or version, no gain of the observer is stable,
            `out` exists, or the compiler is missing or fails.
        TranslationError, ParameterSetError, QuantityError, OSError: for the same reasons as from `export_c`.
    """
    h = checked_step(step)
    farad = optional_si(piezo_capacitance, "F", "piezo_capacitance")
    if fmi not in tuple(_BINARIES):
        raise ExportError(f"fmi = {fmi!r}: known are versions 2 and 3")
    if mode not in get_args(Mode):
        raise ExportError(f"mode = {mode!r}: known are {', '.join(get_args(Mode))}")
    found = exported(source)
    noise = checked_noise(measurement_noise, found.model)
    if mode != "plant" and not isinstance(found.model, Actuator):
        raise ExportError(f"mode = {mode!r} is for an Actuator, not for a {type(found.model).__name__}")
    if mode == "feedforward" and getattr(found.model, "piezo", None) is not None:
        raise ExportError(
            "mode = 'feedforward' is not for an actuator with a piezo, whose hysteresis has a past: play the "
            "drive of inverse_drive, or call stickslip_piezo_inverse of the exported C"
        )
    if not isinstance(compiler, str):
        raise ExportError(f"compiler = {compiler!r} is no command, such as 'gcc'; '' leaves the binary out")
    if compiler and shutil.which(compiler) is None:
        raise ExportError(f"the compiler {compiler!r} is not installed; compiler = '' leaves the binary out")
    parts = signal_chain(found, amplifier, farad, sensor, chain)
    driven = mode != "feedforward" and parts.amplifier is None and isinstance(found.model, Actuator)
    if fmi == 3 and driven and cannot_jump(found.model):
        raise ExportError(
            f"{STATIC_JUMPS}, and FMI 3 holds an input over a step: give the stage a natural_frequency, or "
            "export fmi = 2, which takes the derivative of the input, or with the amplifier"
        )
    files = core_files(found, parts, h, noise, any_layout=True)
    name = re.sub(r"\W", "_", Path(found.model.name).stem) or type(found.model).__name__.lower()
    identifier = f"{name}_{mode}" if name[0].isalpha() else f"model_{name}_{mode}"
    rest = float(default_waveform(found.model, parts.amplifier).drive(h).before)
    everything = "".join(files[key] for key in sorted(files)) + identifier + str(fmi)
    token = "{" + hashlib.sha256(everything.encode()).hexdigest()[:32] + "}"
    all_of = variables(found, parts, mode, h, rest)
    files["fmi_variables.h"] = heading(found) + variables_h(all_of, mode, token, h, rest)
    for file in (f"fmi{fmi}.c", "fmi_instance.h", "fmi_shell.h", *_HEADERS[fmi]):
        files[file] = (C / "fmi" / file).read_text(encoding="utf-8")
    law = type(found.model.friction).__name__
    title = f"Stick-slip actuator {found.model.name} with {law} friction, {mode}".replace("  ", " ")
    made = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with whole(out) as folder:
        root = folder / "unzipped"
        (root / "sources").mkdir(parents=True)
        write_files(root / "sources", files)
        description = model_description(fmi, identifier, token, title, made, all_of, h)
        (root / "modelDescription.xml").write_text(description, encoding="utf-8")
        if fmi == 3:
            text = build_description(identifier)
            (root / "sources" / "buildDescription.xml").write_text(text, encoding="utf-8")
        licences = root / "documentation" / "licenses"
        licences.mkdir(parents=True)
        shutil.copy(C / "LICENSE.txt", licences / "license.txt")
        if compiler:
            _compile(compiler, root, fmi, identifier)
        with zipfile.ZipFile(folder / f"{identifier}.fmu", "w", zipfile.ZIP_DEFLATED) as packed:
            for file in sorted(root.rglob("*")):
                if file.is_file():
                    packed.write(file, file.relative_to(root))
        shutil.rmtree(root)
    return Path(out) / f"{identifier}.fmu"


def _compile(compiler: str, root: Path, fmi: int, identifier: str) -> None:
    """Compile the sources in the folder `root` of an FMU to a shared library for 64-bit Linux.

    The library is written to the folder binaries, under the name `identifier`. Warnings count as errors.

    Raises:
        ExportError: the compiler fails; the message contains the compiler's errors.
    """
    target = root / "binaries" / _BINARIES[fmi]
    target.mkdir(parents=True)
    command = [
        *(compiler, "-std=c99", "-O2", "-fPIC", "-shared"),
        *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"),
        *("-I", str(root / "sources"), *(str(root / "sources" / file) for file in sources(fmi))),
        *("-o", str(target / f"{identifier}.so"), "-lm"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ExportError(f"{compiler} could not compile the FMU: {done.stderr.strip()[:2000]}")
