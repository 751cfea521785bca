"""Sort the rows of docs/data_dictionary.md as the columns are declared.

The document says what each column means. A new column without a row is named: write its row.

Example: python scripts/data_dictionary.py
"""

import re
from pathlib import Path

from bayes_toe.answers.contrast import CONTRAST_COLUMNS
from bayes_toe.answers.evidence_table import EVIDENCE_COLUMNS
from bayes_toe.answers.serial_dependence import HISTORY_COLUMNS
from bayes_toe.classical.asymmetry import ASYMMETRY_COLUMNS
from bayes_toe.classical.fit import fit_columns
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.design.power import GroupPower, PowerEstimate
from bayes_toe.design.study_design import DESIGN_COLUMNS
from bayes_toe.groups.population_table import SUBJECT_COLUMNS, PopulationRow
from bayes_toe.inference.subject import SUMMARY_COLUMNS

OUTPUT = Path(__file__).resolve().parents[1] / "docs" / "data_dictionary.md"
SECTION = "\n## "
_ROW = re.compile(r"^\| `([^`]+)` \| (.*) \|$", flags=re.MULTILINE)
#: By file its columns.
FILES = {
    "summary.csv": SUMMARY_COLUMNS,
    "evidence.csv": EVIDENCE_COLUMNS,
    "history.csv": HISTORY_COLUMNS,
    "contrast.csv": CONTRAST_COLUMNS,
    "population.csv": PopulationRow._fields,
    "population_subjects.csv": SUBJECT_COLUMNS,
    "fit.csv": fit_columns(SAME_DIFFERENT),
    "asymmetry.csv": ASYMMETRY_COLUMNS,
    "power.csv": PowerEstimate._fields,
    "power_groups.csv": GroupPower._fields,
    "design.csv": DESIGN_COLUMNS,
}


def words(section: str) -> dict[str, str]:
    """What a section of the document says of its columns."""
    return dict(_ROW.findall(section))


def updated(document: str) -> str:
    """The document with the rows of declared columns in their order."""
    head, *sections = document.split(SECTION)
    for i, section in enumerate(sections):
        before, rule, _ = section.partition("|---|---|\n")
        name, meanings = section.partition("\n")[0], words(section)
        columns = FILES.get(name, meanings)
        missing = set(columns) - meanings.keys()
        if missing:
            raise SystemExit(f"{OUTPUT.name}: {name}: no row for {', '.join(missing)}")
        rows = [f"| `{column}` | {meanings[column]} |\n" for column in columns]
        sections[i] = before + rule + "".join(rows)
    return SECTION.join([head, *sections])


def main() -> None:
    """Write the document."""
    OUTPUT.write_text(updated(OUTPUT.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
