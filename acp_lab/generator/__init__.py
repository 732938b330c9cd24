"""Generators t(I): from image control points to the edges a view shows.

Their training is in modules of its own, which need torch.
"""

from __future__ import annotations

from acp_lab.generator.base import GeneratedEdges, RigidGenerator, VisibleSamples, generate_edges, project_samples
from acp_lab.generator.painted.image_generator import AutoencoderGenerator
from acp_lab.generator.templates import TemplateGenerator, build_templates
from acp_lab.generator.visibility import RegionNetwork, VisibilityNetwork

__all__ = [
    "AutoencoderGenerator",
    "GeneratedEdges",
    "RegionNetwork",
    "RigidGenerator",
    "TemplateGenerator",
    "VisibilityNetwork",
    "VisibleSamples",
    "build_templates",
    "generate_edges",
    "project_samples",
]
