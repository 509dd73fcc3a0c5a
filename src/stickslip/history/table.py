"""History of a folder as a pandas table."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING

from .index import COLUMNS, Index

if TYPE_CHECKING:
    import pandas as pd


def runs(folder: str | os.PathLike[str], search: str = "", **equal: str) -> pd.DataFrame:
    """Return the runs (recordings, fits, experiments, parameter sets) of a folder and its subfolders, the
    newest first, as a pandas table with one row per run. A value that a run lacks is "" (for settings and
    links {}).

    Columns:

    * name (the path in the folder); kind (recording, prediction, fit, verification, parameters; run: an
      experiment without a recording; folder: a folder that cannot be searched);
    * changed (time of the last change, UTC), bytes, begun (time of the start), seconds (duration), samples;
    * title, notes, tags, operator, rig, parameter_set, channels (texts);
    * outcome ("complete"; the reason of a stop; for a fit "not as required: ..." or, until its end, its
      phase);
    * settings (a dictionary: variables, capture, limits, drive, actuator; the results of a fit; the values of
      a parameter set);
    * links (a dictionary from kinds of links, such as "fitted", to lists of names of runs);
    * problem (reason why a file cannot be read).

    An index beside the files (``.stickslip/runs.sqlite``) makes later calls faster; it may be deleted at any
    time. Samples that a killed program left in the folder are first saved as a recording.

    Args:
        folder: folder of the laboratory.
        search: words that must all occur in the texts of a row; upper and lower case are the same.
        equal: for some columns, the text with which the column must start: ``outcome="stopped"``,
            ``operator="Kang"``.

    Raises:
        OSError: the folder does not exist.
        ValueError: a column is unknown.
    """
    import pandas as pd

    with Index(folder) as index:
        found = pd.DataFrame(index.rows(search, **equal), columns=pd.Index(COLUMNS))
    for column in ("settings", "links"):
        found[column] = [json.loads(text) if text else {} for text in found[column]]
    found["changed"] = pd.to_datetime(found["changed"], unit="s", utc=True, errors="coerce")
    return found
