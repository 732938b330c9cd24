"""The shipped sample, prepared in a second with coarse templates, for tests that need a real part in a real image."""

from __future__ import annotations

from functools import cache

from acp_lab.cad.edges import sample_edges
from acp_lab.cad.raycast import make_caster
from acp_lab.generator.templates import build_templates
from acp_lab.prepared_part import PreparedPart
from acp_lab.sample import sample_dataset
from acp_lab.sequences import open_sequence
from acp_lab.sequences.bop import BopScene


@cache
def sample_scene() -> BopScene:
    """Its one sequence."""
    return open_sequence(sample_dataset())


@cache
def sample_model() -> PreparedPart:
    """Its part."""
    part = sample_scene().dataset.part(1)
    edges = sample_edges(part)
    templates = build_templates(part, edges, make_caster(part), subdivisions=3)
    return PreparedPart(part, edges, templates=templates)
