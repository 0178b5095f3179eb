"""The command line: its verbs, and the folders they write."""
