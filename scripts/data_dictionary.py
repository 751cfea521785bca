"""Bring docs/data_dictionary.md up to date.

A row for every declared column, in the words of a docstring.

What no docstring says stands in the document alone. A column that is new and has no words is named:
write its row there.

Example: python scripts/data_dictionary.py
"""

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from bayes_toe.answers.contrast import CONTRAST_COLUMNS, Difference
from bayes_toe.answers.evidence_table import EVIDENCE_COLUMNS, SubjectEvidence
from bayes_toe.answers.order_effect import ANSWER_COLUMNS
from bayes_toe.answers.serial_dependence import HISTORY_COLUMNS
from bayes_toe.classical.asymmetry import ASYMMETRY_COLUMNS, Comparison, SubjectAsymmetry
from bayes_toe.classical.fit import SubjectFit, fit_columns
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.design.power import DATA_SET_COLUMNS, GROUP_COLUMNS, POWER_COLUMNS
from bayes_toe.design.study_design import DESIGN_COLUMNS
from bayes_toe.groups.population_table import SUBJECT_COLUMNS, PopulationRow
from bayes_toe.inference.subject import SUMMARY_COLUMNS

OUTPUT = Path(__file__).resolve().parents[1] / "docs" / "data_dictionary.md"
SECTION = "\n## "
_ROW = re.compile(r"^\| `([^`]+)` \| (.*) \|$", flags=re.MULTILINE)


class File(NamedTuple):
    """Columns of a file, the records that explain them, and columns that the document explains."""

    columns: Sequence[str] = ()
    explained: Sequence[type] = ()
    better: Sequence[str] = ()

    def words(self, column: str) -> str:
        """What a docstring says of a column, as it is read in a file; empty where none does."""
        if column in self.better:
            return ""
        text = "".join(explanation(kind, column) for kind in self.explained)
        plain = " ".join(re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", text).replace("|", r"\|").split())
        plain = re.sub(r"\bNone where\b", "empty where", plain)
        return plain[:1].upper() + plain[1:]


FILES = {
    "summary.csv": File(SUMMARY_COLUMNS),
    "evidence.csv": File(
        EVIDENCE_COLUMNS, [SubjectEvidence], [*ANSWER_COLUMNS, "log_bayes_factor_laplace"]
    ),
    "history.csv": File(HISTORY_COLUMNS),
    "contrast.csv": File(CONTRAST_COLUMNS, [Difference], ["p_direction", "word", "robust"]),
    "population.csv": File(PopulationRow._fields, [PopulationRow], ["quantity"]),
    "population_subjects.csv": File(SUBJECT_COLUMNS),
    "fit.csv": File(fit_columns(SAME_DIFFERENT), [SubjectFit], ["at_edge", "replicates"]),
    "asymmetry.csv": File(ASYMMETRY_COLUMNS, [Comparison, SubjectAsymmetry]),
    "power.csv": File(POWER_COLUMNS),
    "power_data_sets.csv": File(DATA_SET_COLUMNS),
    "power_groups.csv": File(GROUP_COLUMNS),
    "design.csv": File(DESIGN_COLUMNS),
}


def explanation(kind: type, name: str) -> str:
    """What a docstring says of an attribute, or of a property; nothing for other names."""
    member = getattr(kind, name, None)
    if isinstance(member, property):
        return inspect.getdoc(member) or ""
    pattern = rf"^{name} : [^\n]*\n((?:    [^\n]*\n?)+)"
    entry = re.search(pattern, f"{inspect.getdoc(kind)}\n", flags=re.MULTILINE)
    return entry[1] if entry else ""


def words(section: str) -> dict[str, str]:
    """What a section of the document says of its columns."""
    return dict(_ROW.findall(section))


def updated(document: str) -> str:
    """The document with the rows that declarations and docstrings ask for."""
    head, *sections = document.split(SECTION)
    for i, section in enumerate(sections):
        before, rule, _ = section.partition("|---|---|\n")
        name, stored = section.partition("\n")[0], words(section)
        file = FILES.get(name, File(tuple(stored)))
        rows = []
        for column in file.columns:
            meaning = file.words(column) or stored.get(column)
            if meaning is None:
                raise SystemExit(f"{OUTPUT.name}: {name}: nothing says what {column} means")
            rows.append(f"| `{column}` | {meaning} |\n")
        sections[i] = before + rule + "".join(rows)
    return SECTION.join([head, *sections])


def main() -> None:
    """Write the document."""
    OUTPUT.write_text(updated(OUTPUT.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
