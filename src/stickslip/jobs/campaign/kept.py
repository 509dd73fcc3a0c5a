"""Storage of a campaign's finished stages (steps of its computation), so that the same command resumes an
interrupted campaign.

A stage is identified by a hash of everything that it depends on: recordings, model, settings and the program
itself. After any change, the dependent stages are computed again. A stage is JSON of records (see
`estimate.saved`): reading it runs no code.
"""

from __future__ import annotations

import gzip
import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...engine.library import sources_hash
from ...estimate.influence import PriorInfluence
from ...estimate.lack import Lack
from ...estimate.posterior import Posterior
from ...estimate.saved import packed, unpacked
from ...gate.errors import GateError, damaged
from ...gate.text import MOST_RESULT_BYTES, load_json, read_file, unzipped
from ...identify.candidates import Comparison
from ...identify.saved import saved_types
from ...identify.walk.explained import Explained
from ...physics.actuator import Actuator
from ...recording.replacing import replaced_whole
from ..analysis.alignment import Aligned
from .file import CampaignFile
from .hysteresis import Hysteresis

FOLDER = "stages"
# Fields of a campaign file on which no fit depends: a change of them does not discard finished stages. Of the
# recordings, the content is part of the hash, not the entry in the file.
_OF_THE_REPORT = {"title", "notes", "experiment", "recordings", "published", "require"}
# Attributes of a recording on which no fit depends.
_OF_A_RECORDING = {"title", "notes", "source"}
# Fields that request optional analyses; each analysis adds its own settings to the hash of its stage.
_BESIDE = {"posterior", "posterior_simulations", "profiles", "model_choice"}

_TYPES = (Comparison, Explained, Hysteresis, Lack, Posterior, PriorInfluence)

T = TypeVar("T")


class Kept(NamedTuple):
    """Store of a campaign's finished stages (steps of its computation).

    The stages are files in `folder`; if it is None, nothing is stored. `key` is the hash, in hexadecimal, of
    everything that all stages depend on. `types` has the classes of a user's own friction laws by name.
    """

    folder: Path | None = None
    key: str = ""
    types: dict[str, type] = {}  # noqa: RUF012  # not changed in place

    @classmethod
    def of(
        cls,
        file: CampaignFile,
        model: Actuator,
        gathered: Sequence[Aligned],
        folder: Path,
        laws: Sequence[type],
    ) -> Kept:
        """Return the store of a campaign's finished stages.

        The folder is created when the first stage is stored.

        Args:
            file: settings of the campaign.
            model: initial model of the fits.
            gathered: prepared recordings.
            folder: folder of the store.
            laws: types of the fitted laws.
        """
        found = hashlib.sha256(_program().encode())
        found.update(file.model_dump_json(exclude=_OF_THE_REPORT | _BESIDE).encode())
        found.update(json.dumps(packed(model)).encode())
        for law in laws:
            found.update(_source(law))
        for one in gathered:
            for part in _parts(one):
                found.update(part)
        return cls(folder, found.hexdigest(), {law.__name__: law for law in laws})

    def stage(self, name: str, compute: Callable[[], T], settings: object = None) -> T:
        """Return the stored result of a stage (step of the computation), or compute and store it.

        Args:
            name: name of the stage.
            compute: function that returns the result.
            settings: settings on which only this stage depends; they are part of its hash.
        """
        if self.folder is None:
            return compute()
        whole = hashlib.sha256(f"{self.key} {name} {settings!r}".encode()).hexdigest()
        path = self.folder / f"{name}-{whole[:16]}.json.gz"
        found = self._read(path, whole)
        if found is not None:
            return found[0]
        made = compute()
        try:
            text = json.dumps({"key": whole, "stage": packed(made)})
        except TypeError:  # the result cannot be stored: the next run computes it again
            return made
        self.folder.mkdir(parents=True, exist_ok=True)
        with replaced_whole(path) as temporary:
            temporary.write_bytes(gzip.compress(text.encode(), 1))
        return made

    def _read(self, path: Path, key: str) -> tuple[Any] | None:
        """Return the stored result of a stage in a tuple; None if it must be computed.

        That is so if the file does not exist, is damaged, or has another hash. The tuple distinguishes a
        stored result None.

        Args:
            path: file of the stage.
            key: hash of everything that the stage depends on.
        """
        types = {one.__name__: one for one in _TYPES}
        try:
            with damaged(GateError, str(path)):
                content = load_json(unzipped(read_file(path, MOST_RESULT_BYTES), str(path)), str(path))
                if content["key"] != key:
                    return None
                return (unpacked(content["stage"], saved_types() | types | self.types),)
        except GateError:
            return None


def own_laws(file: CampaignFile, folder: Path) -> list[type]:
    """Return the classes of the user's own friction laws that a campaign compares; [] without any."""
    choice = [] if isinstance(file.model_choice, bool) else file.model_choice
    return [type(one.candidate(folder).model) for one in choice if not isinstance(one, str)]


def _program() -> str:
    """Return a hash of the sources of package and engine, in hexadecimal: a new version computes all stages
    again."""
    found = hashlib.sha256(sources_hash().encode())
    root = Path(__file__).parents[2]
    for path in sorted(root.rglob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()


def _source(law: type) -> bytes:
    """Return the content of the file that defines a law, as bytes, or the law's name if there is no such
    file."""
    try:
        return Path(inspect.getfile(law)).read_bytes()
    except (OSError, TypeError):
        return law.__qualname__.encode()


def _text(attributes: Mapping[Any, Any]) -> bytes:
    return repr(sorted((str(name), str(value)) for name, value in attributes.items())).encode()


def _parts(one: Aligned) -> Iterable[bytes]:
    """Yield the data of a recording that identify it in a hash, as bytes.

    They are name, use, start, noise, the attributes of the recording on which a fit may depend, values and
    attributes (such as the uncertainty of a scale) of all variables, and the drives.
    """
    yield repr((one.name, one.use, one.begin, one.noise, one.forward)).encode()
    yield _text({k: v for k, v in one.recording.attrs.items() if k not in _OF_A_RECORDING})
    for name in sorted(map(str, one.recording.variables)):
        values = one.recording[name]
        yield repr(name).encode() + _text(values.attrs)
        if values.dtype.kind in "fiub":
            yield np.ascontiguousarray(values.values).tobytes()
    for drive in (one.wanted, one.drive):
        if drive is not None:
            table = drive.drive(float(one.recording["time"][-1]))
            for part in (np.array(table.before), table.start, table.polynomial, table.first, table.harmonic):
                yield np.ascontiguousarray(part).tobytes()
