"""Runnable recipes, one per data source; each writes a data set in the BOP layout.

The toolkit `acp_lab` never imports this package: recipes make data, the toolkit reads it.
"""
