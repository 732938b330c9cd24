"""Pictures drawn with matplotlib, which need no display: one module per study or result, named after it.

Each `draw_...` function draws on axes that it is given, so that a notebook arranges the panels; `..._figure` makes a
whole figure. Only the numbers of the result are drawn: nothing is computed here that a study should have computed.
"""
