"""Fixtures of the recipes' tests; all of them need manifold3d, which the `recipes` extra installs."""

from __future__ import annotations

import pytest

pytest.importorskip("manifold3d", reason="the recipes need manifold3d: pip install acp_lab[recipes]")
