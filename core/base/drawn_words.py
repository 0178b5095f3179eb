"""Words as they stand in drawings, which are XML."""

from html import escape


def in_xml(words: str) -> str:
    """Words with their signs escaped, and a blank for each that XML has no sign for: names in
    Blender may hold any.
    """
    return escape("".join(letter if letter.isprintable() else " " for letter in words))
