"""Runnable recipes, one per data source; each writes a data set in the BOP layout.

Synthetic: `metal_sequences`. Converted: `rt_less`, `t_less` (and any BOP data set), `bcot`, `rbot`. Your own part and
camera: `own_video`. A picture of any of them: `contact_sheet`. The toolkit `acp_lab` never imports this package:
recipes write data sets, the toolkit reads them.
"""
