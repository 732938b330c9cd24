"""`python -m acp_lab` is `acp-lab`."""

from __future__ import annotations

import sys

from acp_lab.cli import main

if __name__ == "__main__":
    sys.exit(main())
