"""The checklist: inspects the scene and lists the remaining steps."""
