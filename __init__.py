"""Kiriko: images inside glass. Imports nothing before
`register`, so that `core` loads without Blender.
"""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from . import languages, operators, panels
    from .core.blender import properties

    languages.register(operators.TIPS)
    properties.register()  # operators and panels ask for them
    operators.register()
    panels.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled: everything goes, in reverse."""
    from . import languages, operators, panels
    from .core.blender import properties

    panels.unregister()
    operators.unregister()
    properties.unregister()
    languages.unregister()
