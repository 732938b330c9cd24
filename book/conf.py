"""The site: course, documents and API reference, built by `make book` with Sphinx and MyST-NB.

The whole checkout is the source, so that links between notebooks and documents are the same here, on the code host and
in JupyterLab. Notebooks are run once and kept in a cache; ACP_BOOK_EXECUTE=off builds without their outputs.
"""

import os
import sys
from pathlib import Path

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
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]

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

# The reference, from the docstrings.
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": False, "show-inheritance": False}
autodoc_typehints = "signature"
python_maximum_signature_line_length = 100
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

# The look: furo follows the reader's dark or light setting, and has a switch.
html_theme = "furo"
html_title = "acp_lab"
html_static_path: list[str] = []
html_theme_options = {"navigation_with_keys": True}
