"""The paper's conditions, its published numbers, and tables of them."""

from __future__ import annotations

SPP = 100
# the conditions, as the paper names them
PLAIN = "no compensation"
HALF = "InFloasion"
SOURCE = "source image"
# on 32 cores of a Threadripper 3970X, 100 spp
PAPER_SECONDS = {"ideal plate": 5.1, "mirror array": 2552.8}
PAPER_DX = {PLAIN: 276.1, HALF: 155.4, SOURCE: 62.8}  # px, mean over the 49 points of photographs

Table = list[list[str]]


def markdown(table: Table) -> str:
    """A table as the page in docs has it."""
    lines = [f"| {' | '.join(row)} |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])
