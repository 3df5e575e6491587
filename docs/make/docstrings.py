"""Extension of griffe for the page of the library: types come from signatures, not from docstrings."""

import re
from typing import Any

import griffe


class Descriptions(griffe.Extension):
    """Take what follows the colon after a parameter's name as its description; show roles as code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring:
            described = re.sub(r"(?m)^(\w[\w, ]*) : (.+)$", r"\1\n    \2", obj.docstring.value)
            obj.docstring.value = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", described)
