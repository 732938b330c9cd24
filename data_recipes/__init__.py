"""Runnable recipes, one per data source; each writes a data set in the BOP layout.

Made here: `metal_sequences`. Brought in: `rt_less`, `t_less` (and any BOP data set), `bcot`, `rbot`. Your own part and
camera: `own_video`. To look at any of them: `contact_sheet`. The toolkit `acp_lab` never imports this package: recipes
make data, the toolkit reads it.
"""
