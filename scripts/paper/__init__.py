"""The paper's results next to ours, and their explanation."""
