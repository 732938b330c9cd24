"""The computations behind the notebooks' experiments and the paper's figures.

Basins of convergence, sensitivity, loss landscapes, ambiguous views, and what each stage of a frame does. A study has
a frozen configuration, one function that runs it, and a frozen result; `display.plots` draws results.
"""
