"""Studies: many members, on one machine or many, that go on after whatever ended them.

A `Study` says which members (`Grid`, `Random`, `Draws`, or several of them), what is done with each
(`SteadySteps`, `WalksFromRest`, a function of your `Own`) and what is kept. `run_study` fills a store that
xarray opens while it grows; docs/studies.md says how to run one on clusters.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
