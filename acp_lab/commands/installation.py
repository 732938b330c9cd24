"""How acp_lab came onto this machine, a checkout or a wheel, so that advice fits."""

from __future__ import annotations

from pathlib import Path

import acp_lab


def checkout() -> Path | None:
    """The checkout that this package runs from; None when it was installed from a wheel."""
    root = Path(acp_lab.__file__).resolve().parent.parent
    return root if (root / "notebooks").is_dir() and (root / "pyproject.toml").is_file() else None


def install_extra(extra: str) -> str:
    """The command that adds an optional extra to this installation."""
    if checkout() is not None:
        return f'python -m pip install -e ".[{extra}]" in the checkout'
    return f'python -m pip install "acp_lab[{extra}]"'
