"""What the offline phase leaves behind: one folder per part, `part.json` and safetensors, no pickle.

    PARTS_DIR/bracket/part.json                     name, mesh hash, options, generators and their reports
                      mesh.safetensors              vertices (mm) and faces
                      edges.safetensors             3D edge samples
                      templates.safetensors         views and what each hides        (generator templates)
                      views.safetensors             what shows from all around       (for the detector)
                      visibility_0.safetensors ...  one network per view region      (generator learned)
                      control_points_0.safetensors  regressed W per view region      (generator autoencoder)
                      autoencoder_0.safetensors ... decoder and latent regressors    (generator autoencoder)

Files are written whole or not at all; part.json comes last, names what is complete and holds the checksums of all.
"""

from __future__ import annotations

from acp_lab.prepared_part.header import (
    FORMAT_VERSION,
    UNSEALED_VERSION,
    check_holds_parts,
    part_folder,
    read_header,
)
from acp_lab.prepared_part.integrity import add_checksums
from acp_lab.prepared_part.model import DEFAULT_EDGE_BREAK_MM, PreparedPart
from acp_lab.prepared_part.options import GENERATORS, PrepareOptions
from acp_lab.prepared_part.trained import RegionReport, Trained

__all__ = [
    "DEFAULT_EDGE_BREAK_MM",
    "FORMAT_VERSION",
    "GENERATORS",
    "UNSEALED_VERSION",
    "PrepareOptions",
    "PreparedPart",
    "RegionReport",
    "Trained",
    "add_checksums",
    "check_holds_parts",
    "part_folder",
    "read_header",
]
