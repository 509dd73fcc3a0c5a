"""Figures from data: functions that take results of the package and return a matplotlib Figure, or its axes.

Only this sub-package imports matplotlib. All figures have the style in `style`. Functions that return a
figure use no pyplot and no global state; those that return axes make the figure with pyplot, for interactive
use.
"""
