"""Figures from data: functions that take recordings and fits and return a matplotlib Figure.

Only this sub-package imports matplotlib. Figures use its object interface (no pyplot, no global state) and
the style in `style`; only `plot` makes figures for interactive use.
"""
