"""A widget that keeps rerun's viewer from the net while it runs in the page: no usage statistics, no news of versions.

The native viewer has a switch for them (see commands/replay.py), the one inside a browser has none.
"""

from __future__ import annotations

import anywidget

from acp_lab.display.widgets.point_canvas import module_text


class TelemetryGuard(anywidget.AnyWidget):
    """Invisible; once it is displayed, requests of the page to rerun's hosts are answered without being sent."""

    _esm = module_text("telemetry_guard.js")
