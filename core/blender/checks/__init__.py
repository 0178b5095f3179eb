"""The checklist: inspects the scene, and names what is left to do."""
