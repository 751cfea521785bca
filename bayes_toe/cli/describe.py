"""Commands that describe a study or saved draws: asymmetry, predict, methods, check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayes_toe.cli import summaries, terminal
from bayes_toe.cli.options import OneSubject, SavedDraws, StudyFile, writes
from bayes_toe.cli.task import PriorTask, TableTask


def asymmetry(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("asymmetry.csv", "Table to write.")] = Path("asymmetry.csv"),
    covariates: Annotated[
        Path | None,
        typer.Option("--covariates", metavar="FILE.csv", help="Columns subject and one per covariate; tests go to NAME_covariates.csv."),
    ] = None,
    task: TableTask,
) -> None:
    """Time-order asymmetry of every comparison without a model: size, exact test, direction.

    [bold]Example[/bold]: bayes-toe asymmetry study.csv -o asymmetry.csv --covariates people.csv
    """
    from bayes_toe.classical.asymmetry import asymmetry as compute
    from bayes_toe.classical.covariates import covariate_tests
    from bayes_toe.data.covariates import read_covariates
    from bayes_toe.data.text_table import is_parquet

    beside = output.with_name(f"{output.stem}_covariates{output.suffix if is_parquet(output) else '.csv'}")
    files = [output] if covariates is None else [output, beside]
    task.require_files(*files)
    people = None if covariates is None else read_covariates(covariates)
    read = study.read()
    terminal.say_study(task.console, read)
    terminal.say_doubts(task.console, read)
    table = compute(read)
    tests = None if people is None else covariate_tests(people, table.outcomes())
    with task.together(*files) as folder:
        table.save(folder / output.name, **task.saving)
        if tests is not None:
            tests.save(folder / beside.name, **task.saving)
    summaries.say_asymmetry(task.console, table)
    if tests is not None:
        summaries.say_covariates(task.console, tests)
    task.say_written("written:", *files)


def predict(
    *,
    posterior: SavedDraws,
    pairs: Annotated[Path, typer.Argument(metavar="PAIRS.csv", help="Columns s1,s2, and isi (seconds) where the study has intervals.")],
    output: Annotated[Path, writes("predictions.csv", "Table to write.")] = Path("predictions.csv"),
    subject: OneSubject = None,
    task: TableTask,
) -> None:
    """Posterior of P(equal), mean and quantiles, for pairs and intervals that need not have been tested.

    [bold]Example[/bold]: bayes-toe predict posterior.nc pairs.csv -o predictions.csv
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.inference.draws import load
    from bayes_toe.inference.prediction import predict_pairs

    task.require_files(output)
    loaded = load(posterior)
    table = predict_pairs(loaded, pairs, loaded.names if subject is None else (subject,))
    write_table(table, output, **task.saving)
    task.say_written(f"{len(table)} predictions in", output)


def methods(
    *,
    results: Annotated[
        Path,
        typer.Argument(
            metavar="RESULTS", help="Folder that run wrote, or draws; population.nc, compare.csv and sensitivity.csv in it are told of."
        ),
    ],
    output: Annotated[Path, writes("methods.md|.tex", "Text; NAME.bib and NAME_*.csv, NAME_*.tex beside it.")] = Path("methods.md"),
    compare: Annotated[
        Path | None,
        typer.Option("--compare", metavar="compare.csv", help="Table that compare wrote, or its folder; if elsewhere."),
    ] = None,
    sensitivity: Annotated[
        Path | None,
        typer.Option("--sensitivity", metavar="sensitivity.csv", help="The same of sensitivity; NAME_parts.csv beside it is told of."),
    ] = None,
    task: TableTask,
) -> None:
    """What was done, for a paper: model, priors, sampling and what it reached, versions, citations, tables for a supplement.

    [bold]Example[/bold]: bayes-toe methods results -o methods.md
    """
    from bayes_toe.cli.markup import Latex
    from bayes_toe.cli.methods import markup_for, read_methods, written
    from bayes_toe.data.tables import write_table

    markup = markup_for(output)
    told = read_methods(results, compare, sensitivity)
    tables = [output.with_name(f"{output.stem}_{name}{suffix}") for name in told.names for suffix in (".csv", ".tex")]
    written_files = [output, output.with_suffix(".bib"), *tables]
    task.require_files(*written_files)
    with task.together(*written_files) as folder:
        text, references = written(told, markup, output.stem)
        (folder / output.name).write_text(text, encoding="utf-8")
        (folder / f"{output.stem}.bib").write_text(references, encoding="utf-8")
        for table in told.tables:
            beside = folder / f"{output.stem}_{table.name}.csv"
            write_table(table.frame, beside, spreadsheet_safe=task.spreadsheet_safe)
            beside.with_suffix(".tex").write_text(table.written(Latex(), output.stem) + "\n", encoding="utf-8")
    terminal.say_notes(task.console, told.notes)
    task.say_written("written:", *written_files)


def check(*, study: StudyFile, task: PriorTask) -> None:
    """What was read, what cannot be learnt from it, and what speaks against pooling its answers, before any sampling.

    [bold]Example[/bold]: bayes-toe check study.csv --prior prior.toml
    """
    from bayes_toe.experiments.answers_check import NOTES, check_answers
    from bayes_toe.experiments.checks import check_study, described

    read, prior = task.read(study)
    terminal.say_study(task.console, read)
    terminal.say_prior(task.console, prior)
    rows = [described(subject) for subject in read]
    terminal.say_table(task.console, "subjects", rows, {"fraction_equal": lambda value: f"{value:.3f}"})
    findings = (*check_study(read, prior), *check_answers(read, prior))
    warnings = [finding for finding in findings if finding.code not in NOTES]
    terminal.say_findings(task.console, warnings)
    terminal.say_findings(task.console, (finding for finding in findings if finding.code in NOTES), "note")
    if not warnings:
        task.console.print("no warnings")
