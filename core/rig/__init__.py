"""A rig as plain data: its parts, their roles, and the settings of a solve."""
