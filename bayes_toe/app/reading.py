"""Read the files of a study for the web page, in a process of its own.

A damaged file may end this process; the server goes on. The result is printed as JSON.
"""

from __future__ import annotations

import json
import shlex
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

import bayes_toe as bt
from bayes_toe.app.job import Job
from bayes_toe.arrays import Record
from bayes_toe.checks.answer_checks import Finding
from bayes_toe.data.column_roles import with_likely_columns
from bayes_toe.data.layouts import with_known_order
from bayes_toe.data.messages import display_name
from bayes_toe.data.options import COLUMNS, changed, parse_columns
from bayes_toe.data.read_table import read_table
from bayes_toe.data.study import pooled
from bayes_toe.data.study_files import with_sheets
from bayes_toe.data.text_table import TextTable
from bayes_toe.errors import option_values, with_remedies


def read_job(job: Job) -> Record:
    """What the page shows of the files: columns, study, problems and remedies.

    `table` or `study` is None if it cannot be read.
    """
    record = job.record()
    paths = [job.folder / name for name in record["files"]]
    options = dict(record["options"])
    swap = options.pop("swap", ())
    exclude = options.pop("exclude", ())

    reading: Record = {"table": None, "problems": [], "remedies": [], "study": None}
    try:
        table = _first_table(paths, options)
        # The roles without options stay on the page if the options are refused.
        reading["table"] = {**describe_table(table), **describe_roles(table, bt.ReadOptions())}
        read_options = _read_options(options)
        reading["table"] |= describe_roles(table, read_options)

        study = bt.read_study(paths, read_options)
        if study.reading.evident:
            # The page shows these options as if the user had chosen them.
            evident = option_values(study.reading.evident)
            columns = {**options.get("columns", {}), **evident.get("columns", {})}
            job.save_options({**record["options"], **evident, "columns": columns})
            read_options = with_remedies(read_options, study.reading.evident)
            reading["table"] |= describe_roles(table, read_options)

        findings = bt.check(study)  # before the decisions, which answer some of them
        reading["study"] = describe_study(changed(study, swap, exclude), findings)
    except bt.InputError as error:
        reading["problems"] = error.problems
        reading["remedies"] = [remedy._asdict() for remedy in error.remedies]
    return reading


def _first_table(paths: Sequence[Path], options: Record) -> TextTable:
    """All columns of the first file, or of its first sheet, whose columns the page shows."""
    file_options = bt.ReadOptions(sheet=options.get("sheet"), encoding=options.get("encoding"))
    all_columns = set  # of the names in a header, the set has all
    sheets, file_options = with_sheets(paths, file_options, all_columns)
    return read_table(
        sheets[0],
        all_columns,
        sheet=file_options.sheet,
        encoding=file_options.encoding,
    )


def _read_options(options: Record) -> bt.ReadOptions:
    """The options of the page as options of reading.

    Names of columns that the command `bayes-toe run` cannot name are refused.
    """
    untypable = [name for name in options.get("where", {}) if "=" in name]
    for role, name in options.get("columns", {}).items():
        if parse_columns(f"{role}={name}") != {role: name}:
            untypable.append(name)
    if untypable:
        raise bt.InputError(
            f"column {display_name(untypable[0])}: its name has a comma or '=', so that no command "
            "can name it. Change the name in the file."
        )
    if "intensity" in options:
        with suppress(ValueError):  # ReadOptions refuses a text that is not a number
            options["intensity"] = float(options["intensity"])
    return bt.ReadOptions(**options)


def describe_table(table: TextTable) -> Record:
    """Names of columns, the first six rows, and how often a column has each text.

    The texts of a column with more than twelve different texts are not counted: they are no codes.
    """
    texts = {}  # by column, each text with its count, the most frequent first
    for name, column in table.columns.items():
        counts = Counter(column.codes.tolist()).most_common()
        if len(counts) <= 12:
            texts[name] = [(column.texts[code], count) for code, count in counts]
    rows = []
    for i in range(min(6, len(table.rows))):
        rows.append([table.columns[name].text(i) for name in table.names])
    return {
        "names": table.names,
        "rows": rows,
        "size": len(table.rows),
        "texts": texts,
    }


def describe_roles(table: TextTable, options: bt.ReadOptions) -> Record:
    """The column of each role, such as {'s1': 'first'}.

    `roles` has the columns by these options, and `automatic` the columns if no option names one.
    `unit` is the unit in the names of the stimuli. `order` has the column that says which stimulus
    came first.
    """
    _, options = with_known_order(table, options)
    order = {}
    # The file has no such column if the onsets of both stimuli say the order.
    if options.interval_column in table.names:
        order = {
            "standard_interval": options.standard_interval,
            "comparison_interval": options.comparison_interval,
        }
    # Without the unit of the options, `with_likely_columns` finds the unit in the names.
    options_without_unit = replace(options, unit=None, intensity=None)
    return {
        "roles": _roles(table.names, options),
        "automatic": _roles(table.names, replace(options, columns={})),
        "order": order,
        "unit": with_likely_columns(table.names, options_without_unit).unit,
    }


def _roles(names: Sequence[str], options: bt.ReadOptions) -> dict[str, str]:
    """The column of each role, by the options or by its name; roles without a column are absent."""
    likely_options = with_likely_columns(names, options)
    return {
        role: likely_options.name(role) for role in COLUMNS if likely_options.name(role) in names
    }


def describe_study(study: bt.Study, findings: Sequence[Finding]) -> Record:
    """The pairs with their counts, notes of reading, and findings with what to do about them."""
    all_trials = pooled(tuple(study))  # the counts of each pair, over all subjects
    n_yes = all_trials.n_yes.tolist()
    n_trials = all_trials.n_trials.tolist()

    described_findings = []
    for finding in findings:
        if finding.option.startswith(("--swap ", "--exclude ")):
            _, target = shlex.split(finding.option)  # '--swap A08:2' -> 'A08:2'
        else:
            target = ""
        described_findings.append({**asdict(finding), "target": target})
    return {
        "answer": study.task.yes,
        "subjects": len({subject.subject_name for subject in study}),
        "units": len(study),  # subjects in conditions
        "trials": all_trials.total_trials,
        "pairs": list(zip(all_trials.pairs, n_yes, n_trials, strict=True)),
        "stimuli": [list(map(study.unit.describe, pair)) for pair in all_trials.pairs],
        "unit": study.unit.stimulus_unit,
        "notes": study.notes,
        "findings": described_findings,
    }


if __name__ == "__main__":
    json.dump(read_job(Job(Path(sys.argv[1]))), sys.stdout)
