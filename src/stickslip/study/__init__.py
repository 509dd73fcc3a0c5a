"""Studies: many simulations (members) on one or several machines, resumable after any interruption.

A `Study` defines the members (`Grid`, `Random`, `Draws`, or several of them), the computation for each
(`SteadySteps`, `WalksFromRest`, or a user's function in `Own`) and the results to keep. `run_study` writes
the results to a store (a Zarr folder), which xarray can open while the study runs. Other functions report the
progress of a study, and compare, merge and export stores. docs/studies.md describes studies on clusters.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
