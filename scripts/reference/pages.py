"""Tables of the pages that scripts write."""

from __future__ import annotations

import pandas as pd


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown.

    Examples
    --------
    >>> print(markdown(pd.DataFrame({"case": ["funnel"], "nats": [0.1]})))
    | case | nats |
    |---|---|
    | funnel | 0.1 |
    """
    lines = ["| " + " | ".join(map(str, table.columns)) + " |"]
    lines.append("|---" * len(table.columns) + "|")
    for row in table.itertuples(index=False):
        lines.append("| " + " | ".join(map(str, row)) + " |")
    return "\n".join(lines)
