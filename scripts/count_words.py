"""Count the words of the documents by entry: prose, code and tables that people write.

Printed output (`text` blocks) and the tables of pages that scripts make are free. Pages made from
docstrings and help when the site is built count as what stands in their file.

Example: python scripts/count_words.py
"""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: By entry its files.
ENTRIES = {
    "README": ("README.md", "docs/index.md"),
    "Tutorial": ("docs/tutorial.md",),
    "How-to": ("docs/how_to.md", "notebooks/corner_exploration.ipynb"),
    "Plan a study": ("docs/planning.md",),
    "Interpreting": ("docs/interpreting.md",),
    "Background": ("docs/background.md", "notebooks/paper.ipynb"),
    "Report it": ("docs/report_it.md",),
    "Validation": (
        "docs/validation.md",
        "docs/alarms.md",
        "docs/calibration.md",
        "docs/calibration_order.md",
        "docs/error_bars.md",
        "docs/error_bars_order.md",
        "docs/speed_vs_error.md",
    ),
    "Reference": (
        "docs/reference.md",
        "docs/commands.md",
        "docs/api.md",
        "docs/api_design.md",
        "docs/api_model.md",
        "docs/api_plots.md",
        "docs/data_dictionary.md",
    ),
}
#: Pages whose tables scripts make.
MADE_TABLES = (
    "docs/alarms.md",
    "docs/calibration.md",
    "docs/calibration_order.md",
    "docs/error_bars.md",
    "docs/error_bars_order.md",
    "docs/speed_vs_error.md",
    "docs/data_dictionary.md",
)
MOST_WORDS = 18_000


def count_words(name: str) -> int:
    """Words of one document that count."""
    text = (ROOT / name).read_text(encoding="utf-8")
    if name.endswith(".ipynb"):
        cells = json.loads(text)["cells"]
        text = "\n".join("".join(cell["source"]) for cell in cells)
    text = re.sub(r"^```text\n.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    if name in MADE_TABLES:
        text = re.sub(r"^\|.*$", "", text, flags=re.MULTILINE)
    return len(text.split())


def count_by_entry() -> dict[str, int]:
    """Words of every entry."""
    return {entry: sum(map(count_words, files)) for entry, files in ENTRIES.items()}


def main() -> None:
    """Print the table."""
    counts = count_by_entry()
    for entry, count in counts.items():
        print(f"{entry:<14}{count:>7,}")
    print(f"{'all':<14}{sum(counts.values()):>7,}  (at most {MOST_WORDS:,})")


if __name__ == "__main__":
    main()
