"""The paper's results beside ours, and their explanation."""
