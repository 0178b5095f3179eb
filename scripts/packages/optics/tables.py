"""Shows the parameters of the house's docstrings as tables in the pages of the Python interface.

There the text after a name's colon is its meaning; mkdocstrings takes it for the type, which the
signature has already.
"""

import re
from typing import Any

import griffe

NAMED = re.compile(r"^(\w+(?:, \w+)*) : ", re.MULTILINE)


class Tables(griffe.Extension):
    """Moves meanings to lines of their own, as numpydoc has them."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring before it is parsed."""
        if obj.docstring is not None:
            obj.docstring.value = NAMED.sub(r"\1\n    ", obj.docstring.value)
