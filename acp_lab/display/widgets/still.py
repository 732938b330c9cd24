"""What a page without a kernel shows of a widget, such as the site of the course: a picture of it."""

from __future__ import annotations

from typing import Any, cast

PICTURES = "../docs/images"
"""As seen from the notebooks."""


class Still:
    """Mixed into a widget, before its base: where it cannot run, the picture `still` of docs/images stands for it."""

    still = ""

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        bundle = cast(Any, super())._repr_mimebundle_(**kwargs)
        data = bundle[0] if isinstance(bundle, tuple) else bundle  # anywidget adds metadata, which are empty
        return {**data, "text/markdown": f"![{type(self).__name__} in JupyterLab]({PICTURES}/{self.still})"}
