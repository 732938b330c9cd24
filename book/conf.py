"""The site: course, documents and API reference, built by `make book` with Sphinx and MyST-NB.

The whole checkout is the source, so that links between notebooks and documents are the same here, on the code host and
in JupyterLab. Notebooks are run once and kept in a cache; ACP_BOOK_EXECUTE=off builds without their outputs.
"""

import importlib.util
import inspect
import os
import sys
from pathlib import Path
from typing import Any

from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import acp_lab  # noqa: E402  (from this checkout)

project = "acp_lab"
author = "The acp_lab contributors"
version = release = acp_lab.__version__
root_doc = "book/index"
include_patterns = ["book/**", "docs/*.md", "notebooks/*.md", "notebooks/*.ipynb", "notebooks/solutions/*.ipynb"]
include_patterns += ["CHANGELOG.md", "CONTRIBUTING.md", "environment.md", "binder/README.md", "benchmarks/README.md"]
include_patterns += ["data_recipes/README.md"]
exclude_patterns = ["book/_build", "**/.ipynb_checkpoints", "notebooks/course_files"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]

# Pages: Markdown and notebooks.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# Links into the source lead nowhere on the site; tests/docs checks that their files exist.
suppress_warnings = ["myst.xref_missing", "myst.header", "mystnb.unknown_mime_type", "misc.highlighting_failure"]
suppress_warnings += ["ref.python"]  # a class is known by its module and by the package that offers it
nb_execution_mode = os.environ.get("ACP_BOOK_EXECUTE", "cache")
nb_execution_timeout = 1800
nb_execution_raise_on_error = True
nb_merge_streams = True
# Widgets need a kernel. Where one is asked to show itself here, its picture stands for it
# (display/widgets/still.py), and no JavaScript for widgets is fetched.
nb_mime_priority_overrides = [("html", "text/markdown", 1)]
nb_ipywidgets_js: dict[str, dict[str, str]] = {}

# nbclient stands in for output widgets by writing to the very socket on which it waits for the cell's reply; a reply
# that arrives just then goes unnoticed, and the build waits for ever. Without it, their output lands in the cell.
_start_client = NotebookClient.__init__


def _without_output_widgets(self: NotebookClient, *args: object, **settings: object) -> None:
    _start_client(self, *args, **settings)
    self.widget_registry = {}


NotebookClient.__init__ = _without_output_widgets  # type: ignore[method-assign]

# Formulas need no network: MathJax comes as a package, whose one file for TeX and SVG goes into the site.
_mathjax = Path(next(iter(importlib.util.find_spec("mathjax").submodule_search_locations)), "static", "mathjax")
mathjax_path = "tex-svg.js"

# The reference, from the docstrings.
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": False, "show-inheritance": False}
autodoc_typehints = "signature"
autodoc_mock_imports = ["plain_arrays"]  # bench.rapid.worker runs as a script, beside that module
python_maximum_signature_line_length = 100
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

# The look: furo follows the reader's dark or light setting, and has a switch.
html_theme = "furo"
html_title = "acp_lab"
html_static_path = [str(_mathjax / "es5" / "tex-svg.js")]
html_extra_path = ["root"]  # the first page, for who comes to the site's root
html_theme_options = {"navigation_with_keys": True}


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-skip-member", _named_like_its_module)


def _named_like_its_module(app: Any, _what: str, name: str, member: object, *_: object) -> bool | None:
    """Whether to leave a function out where its package offers it: it would have the address of its module."""
    module = str(getattr(member, "__module__", ""))
    is_of_its_name = inspect.isfunction(member) and module.endswith(f".{name}")
    return True if is_of_its_name and not app.env.docname.endswith(module) else None
