"""Tables of text, as Markdown and as HTML."""

from __future__ import annotations

import html

Table = list[list[str]]


def markdown(table: Table) -> str:
    """A table as the page in docs has it."""
    lines = [f"| {' | '.join(row)} |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])


def html_table(table: Table) -> str:
    rows = [[html.escape(cell) for cell in row] for row in table]
    head = "".join(f"<th>{cell}</th>" for cell in rows[0])
    body = ("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f"<table><tr>{head}</tr>{''.join(body)}</table>"
