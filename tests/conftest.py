"""Fixtures that every layer's tests may use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from acp_lab.geometry.camera import Camera

PROJECT = Path(__file__).resolve().parents[1]

# The same examples on every run and no time limit per example: a busy machine must not fail a test.
# `pytest --hypothesis-profile=explore` draws new and more examples.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of shared real sequences beside the project; tests that need it skip where it is not."""
    folder = PROJECT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the shared sequences are not on this machine (looked for {folder})")
    return folder


@pytest.fixture
def camera() -> Camera:
    """A small camera without distortion, with unequal focal lengths so that x and y cannot be mixed up."""
    return Camera(width=640, height=512, fx=600.0, fy=620.0, cx=319.5, cy=250.25)


@pytest.fixture
def distorted_camera() -> Camera:
    """The same camera behind a lens with clearly visible barrel distortion."""
    return Camera(640, 512, 600.0, 620.0, 319.5, 250.25, (-0.25, 0.08, 0.001, -0.0005, -0.01))


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same on every run."""
    return np.random.default_rng(20240501)
