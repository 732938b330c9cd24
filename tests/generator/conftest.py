"""A bracket, its edges and its templates, made once for this layer's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from acp_lab.cad.edges import EdgeSamples, sample_edges
from acp_lab.cad.part import Part
from acp_lab.cad.raycast import RayCaster, make_caster
from acp_lab.generator.templates import TemplateGenerator, build_templates
from tests.made_parts import bracket


@pytest.fixture(scope="session")
def part() -> Part:
    return bracket(shift=(100.0, -50.0, 20.0))


@pytest.fixture(scope="session")
def edges(part: Part) -> EdgeSamples:
    return sample_edges(part)


@pytest.fixture(scope="session")
def caster(part: Part) -> RayCaster:
    return make_caster(part)


@pytest.fixture(scope="session")
def templates(part: Part, edges: EdgeSamples, caster: RayCaster) -> TemplateGenerator:
    return build_templates(part, edges, caster)


@pytest.fixture
def one_torch_thread() -> Iterator[None]:
    """Matrices this small gain nothing from a second one, and two that wait for each other on a busy machine crawl."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
