"""Computations that the notebooks and the paper's figures ask for: basins, sensitivity, landscapes, ambiguity.

A study has a frozen configuration, one function that runs it, and a frozen result; `display.plots` draws results.
"""
