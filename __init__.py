"""Kiriko: images inside glass. Nothing is imported before `register`, so `core` loads without
Blender.
"""


def register() -> None:
    """Register everything when Blender enables the extension."""
    from . import languages, operators, panels
    from .core.blender import properties

    languages.register(operators.TIPS)
    properties.register()  # operators and panels read them
    operators.register()
    panels.register()


def unregister() -> None:
    """Unregister everything, in reverse order, when Blender disables the extension."""
    from . import languages, operators, panels
    from .core.blender import properties

    panels.unregister()
    operators.unregister()
    properties.unregister()
    languages.unregister()
