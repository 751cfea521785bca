"""Pages that scripts write: options, tables and files."""

from __future__ import annotations

import platform
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import Template

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable, whole_file
from bayes_toe.workers import run_in_order
from reference.calibration_statistics import LEAST_P

#: Titles of the columns of a table of judgements, in their order.
TITLES = {
    "design": "design",
    "what": "what",
    "data_sets": "data sets",
    "with_effect": "with the effect",
    "missing_h1": "none, H1",
    "missing_h0": "none, H0",
    "ece": "ECE",
    "floor": "floor",
    "largest_difference": "largest difference",
    "at": "at",
    "p_value": "p",
    "log_score_bits": "log score",
    "default_bits": "default's",
    "largest_shift": "largest shift",
    "calibrated": "calibrated",
}


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown, with three digits of each number, and '-' where there is none.

    Examples
    --------
    >>> print(markdown(pd.DataFrame({"case": ["funnel", "peak"], "nats": [0.1, np.nan]})))
    | case | nats |
    |---|---|
    | funnel | 0.1 |
    | peak | - |
    """
    texts = table.copy()
    for name in table.select_dtypes("float"):
        texts[name] = table[name].map("{:,.3g}".format).replace("nan", "-")
    rows = [list(texts.columns), *texts.fillna("-").to_numpy(object).tolist()]
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    lines.insert(1, "|---" * len(table.columns) + "|")
    return "\n".join(lines)


def judgement_tables(
    table: pd.DataFrame, titles: Mapping[str, Mapping[str, str]]
) -> dict[str, str]:
    """The rows of each part of a table of judgements in Markdown; `titles` has its own titles."""
    texts = table.convert_dtypes().assign(
        what=table["what"].str.replace("_", " ").replace("jnd", "JND"),
        calibrated=table["calibrated"].map({True: "yes", False: "**no**"}),
    )
    tables = {}
    for part, own_titles in titles.items():
        rows = texts[texts["part"] == part].dropna(axis=1, how="all")
        columns = [column for column in TITLES if column in rows]
        tables[part] = markdown(rows[columns].rename(columns={**TITLES, **own_titles}))
    return tables


def judgement_lines(table: pd.DataFrame) -> list[str]:
    """How many rows of each part are calibrated, and which are not."""
    lines = []
    for part, title in {"probability": "Probabilities", "rank": "Ranks"}.items():
        rows = table[table["part"] == part]
        bad = rows[~rows["calibrated"].astype(bool)]
        line = f"In the table *{title}*, {len(rows) - len(bad)} of {len(rows)} rows are calibrated."
        if len(bad):
            names = bad["design"] + " " + bad["what"].str.replace("_", " ")
            line += f" These rows are not calibrated: {', '.join(names)}."
        lines.append(line)
    return lines


def render(script: str, **values: object) -> str:
    """The page of a script, by the template beside it."""
    text = Path(script).with_suffix(".md").read_text("utf-8")
    versions = {"python": platform.python_version(), "numpy": np.__version__}
    versions["version"] = bt.__version__
    page = Template(text, trim_blocks=True).render(versions=versions, **values)
    return f"{page}\n"


def judgement_page(
    script: str,
    table: pd.DataFrame,
    conclusive: pd.DataFrame,
    titles: Mapping[str, Mapping[str, str]],
    **values: object,
) -> str:
    """The page of a table of judgements."""
    return render(
        script,
        conclusion=judgement_lines(conclusive),
        tables=judgement_tables(table, titles),
        least_p=LEAST_P,
        **values,
    )


def print_judgements(table: pd.DataFrame) -> int:
    """Print whether all rows are calibrated; exit code 3 where one is not."""
    print(*judgement_lines(table), sep="\n")
    return 0 if table["calibrated"].all() else 3


def number_parser(description: str, **numbers: int) -> ArgumentParser:
    """A parser with options that take whole numbers, by name their defaults."""
    parser = ArgumentParser(description=description, formatter_class=RawDescriptionHelpFormatter)
    for name, default in numbers.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, default=default)
    return parser


def page_parser(description: str, **numbers: int) -> ArgumentParser:
    """The same, with the options of all scripts that write a table and a page."""
    parser = number_parser(description, **numbers)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    return parser


def run_rows(jobs: Sequence[Callable[[], object]], workers: int | None) -> pd.DataFrame:
    """The rows that jobs return, in their order."""
    return pd.DataFrame(run_in_order(jobs, workers, None, [()] * len(jobs)))


def write_page(
    options: Namespace, stem: str, work: Callable[[], tuple[pd.DataFrame, str]]
) -> pd.DataFrame:
    """Write the table and the page that the work returns; stop before it where files exist."""
    table_file, page_file = options.output / f"{stem}.csv", options.output / f"{stem}.md"
    try:
        for path in (table_file, page_file):
            require_writable(path, overwrite=options.overwrite)
        table, text = work()
        write_table(table, table_file, overwrite=options.overwrite)
        with whole_file(page_file, overwrite=options.overwrite) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    return table
