"""Pictures from data: functions that take recordings and fits and return a matplotlib Figure.

The only room that knows matplotlib. Pictures are drawn with its object interface (no pyplot, no global
state), in the one style of `style`; but for `plot`, whose new figures somebody looks at.
"""
