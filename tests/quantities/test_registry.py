"""What is known by name: one file adds one, of the package, of another package, of the user."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.identify.saved import load_fit, save_fit
from stickslip.jobs.analysis.file import RecordingFile
from stickslip.jobs.analysis.loops import LawSpec
from stickslip.panel.document import BenchDocument
from stickslip.panel.exploration import SliderState, python
from stickslip.panel.folder import Folder
from stickslip.panel.sets import Sets
from stickslip.panel.sliders import choices
from stickslip.parameters.writing import parameter_text
from stickslip.quantities import registry
from stickslip.quantities.input_file import yaml_text
from stickslip.quantities.registry import RegistryError
from stickslip.quantities.units import QuantityError
from stickslip.recording.drive import drive_text, named_drive
from stickslip.rig.description import open_device, virtual_device
from stickslip.rig.experiment.cells import drive_of
from stickslip.rig.experiment.file import PartSpec, json_schema
from stickslip.rig.hosted import stop_all
from stickslip.study.own import own_function

LAW = '''
from typing import Annotated, NamedTuple

from stickslip.friction import register_law
from stickslip.quantities.records import Quantity, record


@record
class ViscousDahl(NamedTuple):
    """Dahl's law with a viscous part."""

    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", above=0)]
    wear: Annotated[float, Quantity("N s/m", "w", "viscous friction", minimum=0)]


def viscous_dahl(law, v, z):
    return law.sigma_0 * z + law.wear * v, v - law.sigma_0 * abs(v) / law.coulomb_force * z


register_law(ViscousDahl, viscous_dahl)
'''
WAVEFORM = '''
import math
from typing import Annotated, NamedTuple

from stickslip.quantities.records import Quantity
from stickslip.waveform.pieces import Piece, repeat
from stickslip.waveform.signal import Unit, breaks_within, signal_record, slope_at, value_at


@signal_record
class Plateau(NamedTuple):
    """Slow rise, a rest on top, then a jump down."""

    amplitude: Annotated[float, Quantity("V", "A", "amplitude")]
    frequency: Annotated[float, Quantity("Hz", "f", "frequency", above=0)]
    rest: Annotated[float, Quantity("", "q", "part of the period on top", above=0, maximum=0.9)]
    periods: Annotated[float | None, Quantity("", "N", "number of periods", minimum=1)] = None
    unit: Unit = "V"

    value, slope, breaks = value_at, slope_at, breaks_within

    @property
    def period(self):
        return 1 / self.frequency

    @property
    def duration(self):
        return math.inf if self.periods is None else self.periods / self.frequency

    def range(self):
        return min(0.0, self.amplitude), max(0.0, self.amplitude)

    def drive(self, duration):
        rise = Piece(0.0, (0.0, self.amplitude * self.frequency / (1 - self.rest)))
        top = Piece(1 - self.rest, (self.amplitude,))
        return repeat([rise, top], self.frequency, self.periods, 0.0, duration)
'''
KANG = ss.load_actuator("kang2007")


@pytest.fixture(autouse=True)
def _as_at_the_start(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test makes known, no other sees, nor does it see what others did."""
    kinds = (registry.laws, registry.waveforms, registry.sensors, registry.readers, registry.rigs)
    for kind in kinds:
        kind.packaged()
        own = {name: {"": of[""]} for name, of in kind._things.items() if "" in of}
        monkeypatch.setattr(kind, "_things", own)
    monkeypatch.setattr(registry, "_USED", {})
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    for name in [name for name in sys.modules if name.startswith(("own_", "wearlaws"))]:
        del sys.modules[name]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder: a law, a waveform, and a parameter set with that law."""
    (tmp_path / "my_law.py").write_text(LAW)
    (tmp_path / "my_waveform.py").write_text(WAVEFORM)
    text = parameter_text(KANG.replace(friction=ss.Dahl(1.4e6, 0.54), name=""), "Mine", "by hand")
    text = text.replace('law = "Dahl"', 'law = "my_law.py:ViscousDahl"').split("[friction.exponent]")[0]
    (tmp_path / "mine.toml").write_text(
        text + '[friction.wear]\nvalue = 5.0\nunit = "N s/m"\nsource = "tried"\n'
    )
    return tmp_path


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, list(map(str, arguments)))


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a new process."""
    monkeypatch.setattr(
        registry.laws, "_things", {n: {"": law} for n, law in registry.laws.packaged().items()}
    )
    monkeypatch.setattr(registry, "_USED", {})
    for name in [name for name in sys.modules if name.startswith("own_")]:
        del sys.modules[name]


def test_own_law_and_waveform_from_files_to_results_and_back(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Named in a parameter set, and simulated.
    model = ss.load_actuator(folder / "mine.toml")
    assert type(model.friction).__name__ == "ViscousDahl"
    assert model.friction.wear == 5.0
    drive = {
        "shape": "my_waveform.py:Plateau",
        "fields": {"amplitude": "65 V", "frequency": "100 Hz", "rest": 0.1},
    }
    wave = drive_of([PartSpec.model_validate(drive)], {}, folder)
    walk = ss.simulate(model, wave, 0.05, sample_rate=20e3)
    ss.save_recording(walk, folder / "walk.nc")
    # Named in YAML, verified, written.
    job = {
        "kind": "verification",
        "title": "Mine",
        "model": "mine.toml",
        "recordings": [{"file": "walk.nc", "drive": drive}],
        "require": ["r_squared > 0.999999"],
    }
    (folder / "job.yaml").write_text(yaml_text(job))
    done = run("verify", folder / "job.yaml", "--out", folder / "out")
    assert done.exit_code == 0, done.output
    results = folder / "out" / "results.json"
    said = json.loads(results.read_text())["numbers"]["model"]
    assert (said["law"], said["law_of"]) == ("ViscousDahl", str(folder / "my_law.py"))
    # Read back, in a process that knows nothing of it: only after the user has named the file.
    again = {key: value for key, value in job.items() if key != "model"} | {"fit": "out/results.json"}
    (folder / "again.yaml").write_text(yaml_text(again))
    command = ["verify", folder / "again.yaml", "--out", folder / "again"]
    forget(monkeypatch)
    refused = run(*command)
    assert refused.exit_code == 2
    assert f"stickslip --use {folder / 'my_law.py'}" in refused.stderr
    assert not [name for name in sys.modules if name.startswith("own_my_law")]
    accepted = run("--use", folder / "my_law.py", *command)
    assert accepted.exit_code == 0, accepted.output


def test_own_law_in_fits_that_are_saved(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law: Any = registry.laws.find("my_law.py:ViscousDahl", folder)(1.4e6, 0.54, 5.0)
    time = np.linspace(0.0, 0.02, 201)
    moved = ss.simulation.friction_response(law, time, 2e-6 * np.sin(2 * np.pi * 100 * time))
    channels = {
        "position": (moved["position"].values, "m"),
        "friction_force": (moved["friction_force"].values, "N"),
    }
    recording = ss.make_recording(time, channels)
    fit = ss.identify_loops([recording], law._replace(coulomb_force=0.4), ["coulomb_force"])
    assert fit.values["coulomb_force"] == pytest.approx(0.54, rel=1e-3)
    save_fit(fit, folder / "fit.json")
    assert load_fit(folder / "fit.json").values == fit.values
    forget(monkeypatch)
    with pytest.raises(ss.estimate.FitError, match=r"my_law.py, which is not run because a result names it"):
        load_fit(folder / "fit.json")
    ss.registry.use_file(folder / "my_law.py")
    assert type(load_fit(folder / "fit.json").model).__name__ == "ViscousDahl"


def test_a_set_in_another_folder_than_its_law_runs_it_where_the_user_has(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = parameter_text(ss.load_actuator(folder / "mine.toml"), "Mine", "a fit")
    forget(monkeypatch)
    elsewhere = folder / "sets"
    elsewhere.mkdir()
    (elsewhere / "fitted.toml").write_text(text)
    with pytest.raises(ValueError, match=r"its own folder only.*stickslip --use .*my_law\.py"):
        ss.load_actuator(elsewhere / "fitted.toml")
    ss.registry.use_file(folder / "my_law.py")
    assert ss.load_actuator(elsewhere / "fitted.toml").friction.wear == 5.0


EVIL = 'from pathlib import Path\nPath(__file__).with_name("ran").touch()\n'


@pytest.mark.parametrize(
    "name", ["../my_law.py", "{folder}/my_law.py", "sub/../../my_law.py", "link.py", "no.py"]
)
def test_python_of_another_folder_is_never_run_for_a_file(name: str, tmp_path: Path) -> None:
    """By dots, by an absolute path, by a link: in parameter sets, jobs, experiments, studies, readers."""
    (tmp_path / "my_law.py").write_text(EVIL)
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "link.py").symlink_to(tmp_path / "my_law.py")
    name = name.format(folder=tmp_path)
    said = "cannot be read" if name == "no.py" else "a file names Python of its own folder only"
    text = parameter_text(KANG.replace(name=""), "Mine", "x").replace('"LuGre"', f'"{name}:Mine"')
    (inner / "mine.toml").write_text(text)
    recording = RecordingFile.model_validate({"file": "a.csv", "reader": f"{name}:scope"})
    fields = {"coulomb_force": 0.5}
    for act in (
        lambda: ss.load_actuator(inner / "mine.toml"),
        lambda: LawSpec.model_validate({"law": f"{name}:Mine", "fields": fields, "free": []}).candidate(
            inner
        ),
        lambda: drive_of([PartSpec.model_validate({"shape": f"{name}:Mine", "fields": {}})], {}, inner),
        lambda: registry.rigs.find(f"{name}:Mine", inner),
        lambda: own_function(f"{name}:function", inner),
        lambda: recording.read(inner),
    ):
        with pytest.raises(ValueError, match=said):
            act()
    for command in ("simulate",) if name == "no.py" else ("cite", "simulate"):
        done = run(command, inner / "mine.toml")
        assert said in done.stderr, done.output
    assert not (tmp_path / "ran").exists()


def test_what_only_reads_runs_no_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "my_law.py").write_text(EVIL + LAW)
    parameters = ss.parameters.load_set(folder / "mine.toml")
    assert parameters.law == "my_law.py:ViscousDahl"
    assert ss.parameters.cite(str(folder / "mine.toml")) == ""
    for command in (["cite", folder / "mine.toml"], ["runs", folder]):
        done = run(*command)
        assert done.exit_code == 0, done.output
        assert ("my_law.py ... does" in done.output) == (command[0] == "cite")
    assert run("cite", f"{folder / 'my_law.py'}:ViscousDahl").exit_code == 2
    with registry.nothing_run(), pytest.raises(RegistryError, match="not run from here"):
        registry.laws.find("my_law.py:ViscousDahl", folder)
    assert not (folder / "ran").exists()
    cited = run("--use", folder / "my_law.py", "cite", folder / "mine.toml")
    assert "% Parameter set" in cited.output
    assert (folder / "ran").exists()


def test_laws_of_identification_files(folder: Path) -> None:
    fields = {"sigma_0": "1.4 N/um", "coulomb_force": 0.5, "wear": 0.0}
    spec = LawSpec.model_validate({"law": "my_law.py:ViscousDahl", "fields": fields, "free": ["wear"]})
    assert spec.candidate(folder).label == "ViscousDahl"
    wrong = spec.model_copy(update={"law": "my_law.py:ViscusDahl"})
    with pytest.raises(ValueError, match=r"no law 'ViscusDahl' \(did you mean 'ViscousDahl'\?\)"):
        wrong.candidate(folder)


def test_own_things_are_listed_and_have_sliders(folder: Path) -> None:
    use = ["--use", folder / "my_law.py", "--use", folder / "my_waveform.py"]
    listed = run(*use, "list", "laws", "waveforms").output
    assert f"Dahl's law with a viscous part. ({folder / 'my_law.py'})" in listed
    assert "Slow rise, a rest on top, then a jump down." in listed
    offered = choices()
    sliders = {one["name"]: one for one in offered["shapes"]["Plateau"]}
    assert list(sliders) == ["amplitude", "frequency", "rest"]
    assert (sliders["rest"]["low"], sliders["rest"]["high"], sliders["rest"]["unit"]) == (0.0, 0.9, "")
    begin = offered["start"]["Plateau"]
    assert begin == {"amplitude": 65.0, "frequency": 5.0, "rest": 0.45}
    wear = offered["by_unit"]["m"]["laws"]["ViscousDahl"][2]
    assert (wear["unit"], wear["scale"]) == ("N s/m", "log")
    friction = offered["sets"]["kang2007"]["friction"]["ViscousDahl"]
    assert friction["sigma_0"] == KANG.friction.sigma_0
    state = SliderState(
        set="kang2007", law="ViscousDahl", friction=friction, shape="Plateau", waveform=begin, duration=1.0
    )
    names: dict[str, Any] = {}
    exec(python(state).split("trajectory")[0], names)  # what the page says runs
    assert type(names["drive"]).__name__ == "Plateau"
    assert names["actuator"].friction.wear == friction["wear"]
    enumerated = json.dumps(json_schema()["$defs"]["PartSpec"])
    assert '"Plateau"' in enumerated
    assert '"Sequence"' not in enumerated


def test_an_own_waveform_is_read_from_recordings_once_it_is_known(folder: Path) -> None:
    wave = registry.waveforms.find("my_waveform.py:Plateau", folder)(65.0, 5.0, 0.2, periods=2.0)
    recording = ss.make_recording([0.0, 1.0], {"drive_voltage": ([0.0, 1.0], "V")}).assign_attrs(
        drive=drive_text(wave)
    )
    assert named_drive(recording) == wave


def test_the_panel_runs_no_file_that_a_request_names(folder: Path) -> None:
    reader: Any = None
    bench = BenchDocument(Folder(folder), reader)
    content = json.loads(json.dumps(bench.checked.content))
    content["runs"][0]["waveform"] = [
        {
            "shape": "my_waveform.py:Plateau",
            "fields": {"amplitude": 1, "frequency": 5, "rest": 0.1, "periods": 2},
        }
    ]
    with pytest.raises(QuantityError, match="not run from here"):
        bench.check(content)
    own = {**bench.checked.content, "actuator": {"set": "mine.toml"}}
    with pytest.raises(QuantityError, match="not run from here"):
        bench.check(own)
    (folder / "parameters").mkdir()
    (folder / "parameters" / "mine.toml").write_text(
        (folder / "mine.toml").read_text().replace("my_law.py", str(folder / "my_law.py"))
    )
    sets = Sets(Folder(folder))
    assert "parameters/mine.toml" not in sets.offered()
    assert not [name for name in sys.modules if name.startswith("own_")]
    ss.registry.use_file(folder / "my_law.py")
    ss.registry.use_file(folder / "my_waveform.py")
    assert "parameters/mine.toml" in sets.offered()
    assert bench.check(content)


def test_the_rig_s_process_gets_the_law_of_its_client(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = virtual_device(ss.load_actuator(folder / "mine.toml"), "kang2007-bench", 0, False)
    forget(monkeypatch)
    assert open_device(json.loads(json.dumps(device)), 0.0).capabilities.inputs


SENSOR = '''
from typing import Annotated, NamedTuple

from stickslip.quantities import registry
from stickslip.quantities.records import Quantity, record


@registry.sensors.add
@record
class Ruler(NamedTuple):
    """A ruler with lines at a pitch."""

    pitch: Annotated[float, Quantity("m", "p", "distance of the lines", above=0)]
    unit = "m"

    def sense(self, position, sample_rate, random):
        return (position / self.pitch).round() * self.pitch
'''
READER = '''
import numpy as np

from stickslip.recording.readers.source import FileChannel, FileContent, add_format


def read_scope(path):
    """A raw file of our oscilloscope: pairs of float32, volts and micrometres."""
    columns = np.fromfile(path, dtype="<f4").reshape(-1, 2).astype(float).T
    channels = (FileChannel("drive_voltage", "V"), FileChannel("end_effector_position", "um"))

    def read(which, rows):
        return [columns[i][rows.start : rows.stop] for i in which]

    return FileContent("scope", channels, read)


add_format(read_scope, "scope", (".raw",))
'''
RIG = '''
from stickslip import load_actuator, registry
from stickslip.rig import VirtualRig, load_bench


@registry.rigs.add
class Mine(VirtualRig):
    """Our rig."""

    def __init__(self, seed):
        super().__init__(load_actuator("kang2007"), load_bench("kang2007-bench"), seed=seed)
'''


def test_an_own_sensor_of_a_bench(tmp_path: Path) -> None:
    (tmp_path / "ruler.py").write_text(SENSOR)
    text = (Path(ss.__file__).parent / "rig" / "benches" / "kang2007-bench.toml").read_text()
    table = """
[sensor.ruler]
type = "ruler.py:Ruler"
on = "end_effector"
[sensor.ruler.pitch]
value = 20
unit = "nm"
source = "drawing"
"""
    (tmp_path / "bench.toml").write_text(text + table)
    sensor: Any = ss.rig.load_bench(tmp_path / "bench.toml").sensors["ruler"].sensor
    assert sensor.sense(np.array([51e-9]), 1e3, None) == pytest.approx([60e-9])
    (tmp_path / "bench.toml").write_text(text + table.replace("ruler.py:Ruler", "ruler.py:Rular"))
    with pytest.raises(ValueError, match=r"no sensor 'Rular' \(did you mean 'Ruler'\?\)"):
        ss.rig.load_bench(tmp_path / "bench.toml")


def test_an_own_reader(tmp_path: Path) -> None:
    (tmp_path / "my_reader.py").write_text(READER)
    samples = np.array([[0.0, 0.0], [65.0, 6.5], [30.0, 3.25]], dtype="<f4")
    samples.tofile(tmp_path / "scope.raw")
    with pytest.raises(ss.recording.RecordingError, match="neither text nor"):
        ss.read_recording(tmp_path / "scope.raw", sample_rate=1e5)
    spec = RecordingFile.model_validate(
        {"file": "scope.raw", "reader": "my_reader.py:scope", "sample_rate": "100 kHz"}
    )
    read = spec.read(tmp_path)
    np.testing.assert_allclose(read["end_effector_position"], [0.0, 6.5e-6, 3.25e-6], rtol=1e-6)
    assert read.attrs["reader"] == "scope"
    assert ss.read_recording(tmp_path / "scope.raw", sample_rate=1e5).equals(read)  # known by its ending now
    samples.tofile(tmp_path / "scope.bin")
    assert ss.read_recording(tmp_path / "scope.bin", sample_rate=1e5, reader="scope").equals(read)
    assert "pairs of float32" in ss.jobs.catalogue("readers")["readers"]["scope"]
    np.save(tmp_path / "still.npy", np.zeros((5, 2)))
    assert ss.inspect_file(tmp_path / "still.npy").reader == "npy"
    (tmp_path / "still.npy").rename(tmp_path / "still.raw")
    with pytest.raises(ss.recording.RecordingError):  # its ending says scope
        ss.read_recording(tmp_path / "still.raw", sample_rate=1e5, reader="npz")


def test_an_own_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STICKSLIP_RIGS", str(tmp_path / "rigs"))
    (tmp_path / "my_rig.py").write_text(RIG)
    experiment = {
        "title": "On our rig",
        "rig": {"kind": "my_rig.py:Mine", "options": {"seed": 3}},
        "channels": {"drive_voltage": {"input": "drive"}},
        "runs": [
            {
                "name": "walk",
                "waveform": [
                    {"shape": "Sawtooth", "fields": {"amplitude": 10, "frequency": 50, "periods": 2}}
                ],
                "capture": {"length": "0.05 s", "interval": "50 us"},
            }
        ],
    }
    (tmp_path / "experiment.yaml").write_text(yaml_text(experiment))
    ss.rig.run_experiment(tmp_path / "experiment.yaml", tmp_path / "out")
    stop_all()
    recorded = ss.open_recording(tmp_path / "out" / "walk.nc")
    assert float(recorded["drive_voltage"].max()) == pytest.approx(10.0, rel=0.05)
    experiment["rig"] = {"kind": "scpy"}
    (tmp_path / "experiment.yaml").write_text(yaml_text(experiment))
    with pytest.raises(ValueError, match=r"rig.*no rig 'scpy' \(did you mean 'scpi'\?\)"):
        ss.rig.run_experiment(tmp_path / "experiment.yaml", tmp_path / "out")


def test_an_installed_package_adds_by_its_entry_points(tmp_path: Path) -> None:
    (tmp_path / "wearlaws.py").write_text(LAW)
    info = tmp_path / "wearlaws-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: wearlaws\nVersion: 1.0\n")
    points = "[stickslip.laws]\nViscousDahl = wearlaws:ViscousDahl\nBroken = wearlaws:Nothing\n"
    (info / "entry_points.txt").write_text(points)
    assert "ViscousDahl" not in registry.laws.names()
    sys.path.append(str(tmp_path))
    assert "ViscousDahl" in registry.laws.names()
    assert "wearlaws" not in sys.modules, "looked at only when it is asked for"
    law = registry.laws.find("ViscousDahl")
    assert law.__module__ == "wearlaws"
    written = registry.laws.written(law)
    assert registry.laws.name_of(law) == "ViscousDahl"
    assert registry.laws.of_results(written) is law
    listed = ss.jobs.catalogue("laws")["laws"]
    assert listed["ViscousDahl"].startswith("Dahl's law with a viscous part.")
    assert "the law 'Broken' of wearlaws cannot be loaded: AttributeError" in listed["Broken"]
    with pytest.raises(RegistryError, match="cannot be loaded"):
        registry.laws.find("Broken")


def test_one_file_in_the_package_adds_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import stickslip.friction

    (tmp_path / "viscous_dahl.py").write_text(LAW)
    monkeypatch.setattr(stickslip.friction, "__path__", [*stickslip.friction.__path__, str(tmp_path)])
    registry._import_room.cache_clear()
    monkeypatch.delitem(sys.modules, "stickslip.friction.viscous_dahl", raising=False)
    assert list(registry.laws.packaged())[-1] == "ViscousDahl"
    assert "ViscousDahl" in ss.jobs.catalogue("laws")["laws"]
    assert "ViscousDahl" in choices()["by_unit"]["m"]["laws"]


def test_an_edited_file_is_run_again_and_another_is_not(folder: Path) -> None:
    first = registry.laws.find("my_law.py:ViscousDahl", folder)
    assert registry.laws.find("ViscousDahl") is first
    assert registry.laws.find("my_law.py:ViscousDahl", folder) is first
    (folder / "my_law.py").write_text(LAW.replace("law.wear * v,", "2 * law.wear * v,"))
    second = registry.laws.find("my_law.py:ViscousDahl", folder)
    assert second is not first
    assert registry.laws.find("ViscousDahl") is second


def test_one_name_for_two_things_has_to_say_which(folder: Path) -> None:
    (folder / "other.py").write_text(LAW)
    registry.laws.find("my_law.py:ViscousDahl", folder)
    other = registry.laws.find("other.py:ViscousDahl", folder)
    assert other.__module__ != registry.laws.find("my_law.py:ViscousDahl", folder).__module__
    with pytest.raises(RegistryError, match=r"more than one law; say which: .*my_law.py:Visc.*other.py:Visc"):
        registry.laws.find("ViscousDahl")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import stickslip\n\n1 / 0\n", r"own.py cannot be used: ZeroDivisionError: .* \(line 3\)"),
        ("raise SystemExit(1)", "own.py cannot be used: SystemExit: 1"),
        ("def wrong(:", "own.py cannot be used: SyntaxError"),
        (None, "own.py cannot be read: No such file"),
        ("", "own.py has no law 'Mine'; it has none"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(tmp_path: Path, text: str | None, said: str) -> None:
    if text is not None:
        (tmp_path / "own.py").write_text(text)
    with pytest.raises(RegistryError, match=said):
        registry.laws.find("own.py:Mine", tmp_path)
    assert not [name for name in sys.modules if name.startswith("own_own")] or text == ""


def test_things_of_the_package_are_no_user_s() -> None:
    assert registry.laws.written(ss.LuGre) == {"law": "LuGre"}
    assert registry.laws.of_results({"law": "LuGre"}) is ss.LuGre
    assert registry.own_path("C:\\laws\\my.py:Law") == ("C:\\laws\\my.py", "Law")
    assert registry.own_path("LuGre") == ("", "LuGre")
    with pytest.raises(RegistryError, match=r"no waveform 'Sawtoth' \(did you mean 'Sawtooth'\?\)"):
        registry.waveforms.find("Sawtoth")
    assert registry.origin(SimpleNamespace(__module__="__main__")) != ""
