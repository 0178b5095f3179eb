"""The command line: its verbs, and the folders that they write."""
