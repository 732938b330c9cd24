"""The methods that benchmarks compare are sums that a tracker takes; what they reach is measured, not tested."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# In a process of its own: the benchmarks limit the threads of the one that imports them.
CODE = """
from benchmarks import ablation, choices, hybrid
from acp_lab.tracking.method import METHODS, Method
compared = {
    "paper": dict(choices.paper_choices()),
    "search": dict(choices.search_choices()),
    "hybrid": {method.name: method for method in hybrid.methods()},
    "ablation": dict(ablation.settings(METHODS[ablation.METHOD_NAMES[0]])),
    "pixels": dict(ablation.settings(METHODS["acp"])),
}
for group, methods in compared.items():
    # The base and one change each: no two are the same.
    assert len(methods) > 1 and all(isinstance(method, Method) for method in methods.values()), group
    assert len({repr(method) for method in methods.values()}) == len(methods), group
assert set(ablation.METHOD_NAMES) <= set(METHODS)
"""


def test_the_methods_that_are_compared_can_be_made_and_differ() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
