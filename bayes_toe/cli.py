"""The command line: parse, call, print. Our errors become one line per problem and exit code 2.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output, 3 done but some subject's draws did not converge.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.errors import BayesToeError

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.covariates import CovariateTable
    from bayes_toe.draws import Draws
    from bayes_toe.fit_table import FitTable
    from bayes_toe.model_evidence import EvidenceTable
    from bayes_toe.response_asymmetry import AsymmetryTable
    from bayes_toe.study import Study

NOT_CONVERGED = 3

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in same/different judgements.\n\n"
    "[bold]Example[/bold]: bayes-toe run study.csv -o results",
)

StudyFile = Annotated[
    Path, typer.Argument(metavar="STUDY.csv", help="Trials (subject,s1,s2,response) or counts (subject,s1,s2,n_equal,n_trials).")
]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Root seed; without it fresh entropy, printed and stored.")]
DrawCount = Annotated[int, typer.Option("--draws", min=1, max=10**6, help="Effective draws to reach for every parameter.")]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes; default one per processor. The numbers do not depend on it.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace outputs that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print problems only.")]
Intensity = Annotated[float | None, typer.Option("--intensity", metavar="REF", help="Columns i1,i2 hold raw amplitudes; s = ln(i / REF).")]
EqualCode = Annotated[str | None, typer.Option("--equal-code", help="The response that means 'equal'.")]
DifferentCode = Annotated[str | None, typer.Option("--different-code", help="The response that means 'different'.")]
Columns = Annotated[
    str | None,
    typer.Option("--columns", metavar="OURS=THEIRS,...", help="Other column names, e.g. subject=participant,s1=first."),
]


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        from bayes_toe import __version__

        typer.echo(f"bayes-toe {__version__}")
        raise typer.Exit


@app.command()
def run(
    study: Annotated[Path | None, typer.Argument(metavar="[STUDY.csv]", help="Trials or counts; none means the bundled example.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Results folder.")] = Path("bayes_toe_results"),
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Posterior, summary, evidence table, corner plots and report of a study, in one folder.

    [bold]Example[/bold]: bayes-toe run study.csv -o results --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.api import run as analyse
        from bayes_toe.api import settings_for
        from bayes_toe.example import example_study, example_truth
        from bayes_toe.outputs import require_folder
        from bayes_toe.results import PRODUCTS, write_results

        require_folder(output, PRODUCTS, overwrite=overwrite)
        read = example_study() if study is None else _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        settings = settings_for(draws=draws, seed=seed)
        with _progress(console, "sampling", len(read)) as tick:
            analysis = analyse(read, settings, workers=workers, progress=tick)
        _say_draws(console, analysis.draws)
        _say_evidence(console, analysis.evidence)
        truth = example_truth() if study is None else None
        with _progress(console, "drawing", len(read)) as tick:
            write_results(analysis, output, overwrite=overwrite, truth=truth, workers=workers, progress=tick)
        console.print(f"seed {settings.seed}; results in [bold]{_safe(output)}[/bold]: {', '.join(PRODUCTS)}", highlight=False)
        _exit_for(analysis.draws)


@app.command()
def sample(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="posterior.nc", help="NetCDF file to write.")] = Path("posterior.nc"),
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Posterior draws of every subject, as NetCDF that ArviZ opens.

    [bold]Example[/bold]: bayes-toe sample study.csv -o posterior.nc --draws 10000 --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.api import draw, settings_for
        from bayes_toe.outputs import require_writable

        require_writable(output, overwrite=overwrite)
        read = _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        settings = settings_for(draws=draws, seed=seed)
        with _progress(console, "sampling", len(read)) as tick:
            made = draw(read, settings, workers=workers, progress=tick)
        made.save(output, overwrite=overwrite)
        _say_draws(console, made)
        console.print(f"seed {settings.seed}; draws in [bold]{_safe(output)}[/bold]", highlight=False)
        _exit_for(made)


@app.command()
def evidence(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="evidence.csv", help="Table to write.")] = Path("evidence.csv"),
    seed: Seed = None,
    workers: Workers = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Evidence of the predictive-update model (H1) against one free frequency per pair (H0).

    [bold]Example[/bold]: bayes-toe evidence study.csv -o evidence.csv --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.api import evidence as compute
        from bayes_toe.outputs import require_writable
        from bayes_toe.seeds import root_seed

        require_writable(output, overwrite=overwrite)
        read = _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        root = root_seed(seed)
        with _progress(console, "evidence", len(read)) as tick:
            table = compute(read, seed=root, workers=workers, progress=tick)
        table.save(output, overwrite=overwrite)
        _say_evidence(console, table)
        console.print(f"seed {root}; table in [bold]{_safe(output)}[/bold]", highlight=False)


@app.command()
def asymmetry(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="asymmetry.csv", help="Table to write.")] = Path("asymmetry.csv"),
    covariates: Annotated[
        Path | None,
        typer.Option("--covariates", metavar="FILE.csv", help="Columns subject and one per covariate; tests go to NAME_covariates.csv."),
    ] = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Time-order asymmetry of every comparison without a model: size, exact test, direction.

    [bold]Example[/bold]: bayes-toe asymmetry study.csv -o asymmetry.csv --covariates people.csv
    """
    with _problems_as_lines():
        from bayes_toe.covariates import covariate_tests, read_covariates
        from bayes_toe.outputs import require_writable
        from bayes_toe.response_asymmetry import asymmetry as compute

        beside = output.with_name(f"{output.stem}_covariates.csv")
        for path in [output] if covariates is None else [output, beside]:
            require_writable(path, overwrite=overwrite)
        people = None if covariates is None else read_covariates(covariates)
        read = _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        table = compute(read)
        tests = None if people is None else covariate_tests(people, table.outcomes())
        table.save(output, overwrite=overwrite)
        _say_asymmetry(console, table)
        if tests is not None:
            tests.save(beside, overwrite=overwrite)
            _say_covariates(console, tests)
        files = [output] if tests is None else [output, beside]
        console.print(f"written: [bold]{', '.join(map(_safe, files))}[/bold]", highlight=False)


@app.command()
def fit(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="fit.csv", help="Table to write.")] = Path("fit.csv"),
    replicates: Annotated[int, typer.Option("--replicates", min=1, max=10**6, help="Bootstrap replicates a subject.")] = 1000,
    level: Annotated[float, typer.Option("--level", help="Level of the bootstrap intervals, between 0 and 1.")] = 0.95,
    seed: Seed = None,
    workers: Workers = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Maximum-likelihood fit of every subject, as in the paper, with percentile bootstrap intervals.

    [bold]Example[/bold]: bayes-toe fit study.csv -o fit.csv --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.bootstrap import require_level
        from bayes_toe.fit_table import fit as compute
        from bayes_toe.outputs import require_writable

        require_level(level)
        require_writable(output, overwrite=overwrite)
        read = _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        with _progress(console, "fitting", len(read)) as tick:
            table = compute(read, replicates=replicates, level=level, seed=seed, workers=workers, progress=tick)
        table.save(output, overwrite=overwrite)
        _say_fits(console, table)
        console.print(f"seed {table.seed}; table in [bold]{_safe(output)}[/bold]", highlight=False)


@app.command()
def figures(
    study: Annotated[Path | None, typer.Argument(metavar="[STUDY.csv]", help="Trials or counts; none means the bundled example.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the figures.")] = Path("figures"),
    subject: Annotated[
        list[str] | None,
        typer.Option("--subject", help="In Figs. 3 and 5, the first also in Fig. 2; repeat for more. Default: three kinds."),
    ] = None,
    formats: Annotated[list[str] | None, typer.Option("--format", help="pdf, png or svg; repeat for more. Default: pdf and png.")] = None,
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """The paper's figures of a study, with captions: 1C, 2 to 6 and Appendix C's.

    [bold]Example[/bold]: bayes-toe figures study.csv -o figures --subject S06 --subject S04 --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.api import run as analyse
        from bayes_toe.api import settings_for
        from bayes_toe.example import example_study
        from bayes_toe.outputs import require_folder
        from bayes_toe.paper_figures import FIGURES, products, require_subjects, write_figures

        chosen = ["pdf", "png"] if formats is None else formats
        require_folder(output, products(chosen), overwrite=overwrite)
        read = example_study() if study is None else _read(study, intensity, equal_code, different_code, columns)
        if subject is not None:
            require_subjects(subject, read.names)
        console = _console(quiet)
        _say_study(console, read)
        settings = settings_for(draws=draws, seed=seed)
        with _progress(console, "sampling", len(read)) as tick:
            analysis = analyse(read, settings, workers=workers, progress=tick)
        _say_draws(console, analysis.draws)
        with _progress(console, "drawing", len(FIGURES)) as tick:
            write_figures(analysis, output, subjects=subject, formats=chosen, overwrite=overwrite, workers=workers, progress=tick)
        console.print(f"seed {settings.seed}; figures and captions in [bold]{_safe(output)}[/bold]", highlight=False)
        _exit_for(analysis.draws)


@app.command()
def corner(
    posterior: Annotated[Path, typer.Argument(metavar="posterior.nc", help="Draws written by run or sample.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for one PNG a subject.")] = Path("corner"),
    subject: Annotated[str | None, typer.Option("--subject", help="Only this subject.")] = None,
    coordinates: Annotated[str, typer.Option("--coordinates", help="natural or identified.")] = "natural",
    workers: Workers = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Corner plots of saved draws, one PNG a subject.

    [bold]Example[/bold]: bayes-toe corner posterior.nc -o corner --subject S01
    """
    with _problems_as_lines():
        from bayes_toe.draws import load
        from bayes_toe.outputs import require_folder, whole_folder
        from bayes_toe.results import corner_files, draw_corners, write_corners

        loaded = load(posterior)
        chosen = loaded.names if subject is None else (loaded.select(subject).names[0],)
        files = corner_files(loaded, chosen)
        require_folder(output, list(files.values()), overwrite=overwrite)
        console = _console(quiet)
        with _progress(console, "drawing", len(chosen)) as tick:
            pictures = draw_corners(loaded, chosen, coordinates=coordinates, workers=workers, progress=tick)
        with whole_folder(output, list(files.values()), overwrite=overwrite) as target:
            write_corners(pictures, target, files)
        console.print(f"{len(files)} corner plot{'' if len(files) == 1 else 's'} in [bold]{_safe(output)}[/bold]", highlight=False)


@app.command()
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="STUDY.csv", help="Trials to write.")],
    truth: Annotated[Path | None, typer.Option("--truth", metavar="truth.csv", help="Where to write the true parameters.")] = None,
    subjects: Annotated[int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")] = 16,
    batches: Annotated[int, typer.Option("--batches", min=1, help="Repetitions of the whole set of pairs.")] = 50,
    amplitudes: Annotated[
        str, typer.Option("--amplitudes", help="Stimuli in units of the reference, weakest first.")
    ] = "1,1.15,1.36,1.55,1.66",
    design: Annotated[
        str, typer.Option("--design", help="reference (the paper's), full (all ordered pairs), or a CSV with s1,s2.")
    ] = "reference",
    population: Annotated[str, typer.Option("--population", help="paper, prior, or a CSV with subject,mu1,sigma_p,sigma_l,q0.")] = "paper",
    seed: Seed = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    with _problems_as_lines():
        from bayes_toe.outputs import require_writable, write_table
        from bayes_toe.recipes import design_from, population_from, trial_frame, truth_frame
        from bayes_toe.seeds import root_seed
        from bayes_toe.simulate import simulate_trials

        for path in [output] if truth is None else [output, truth]:
            require_writable(path, overwrite=overwrite)
        root = root_seed(seed)
        chosen = design_from(design, amplitudes, batches)
        names, observers = population_from(population, subjects, root)
        trials = simulate_trials(names, observers, chosen, root)
        write_table(trial_frame(trials), output, overwrite=overwrite)
        if truth is not None:
            write_table(truth_frame(names, observers), truth, overwrite=overwrite)
        total = sum(len(one.equal) for one in trials)
        console = _console(quiet)
        console.print(f"{len(names)} synthetic subjects, {total} trials in [bold]{_safe(output)}[/bold]; seed {root}", highlight=False)


@app.command()
def check(
    study: StudyFile,
    intensity: Intensity = None,
    equal_code: EqualCode = None,
    different_code: DifferentCode = None,
    columns: Columns = None,
    quiet: Quiet = False,
) -> None:
    """What was read, and what cannot be learnt from it, before any sampling.

    [bold]Example[/bold]: bayes-toe check study.csv
    """
    with _problems_as_lines():
        from bayes_toe.checks import check_study, describe

        read = _read(study, intensity, equal_code, different_code, columns)
        console = _console(quiet)
        _say_study(console, read)
        frame = describe(read)
        formats: dict[str, Callable[[Any], str]] = {"fraction_equal": lambda value: f"{value:.3f}"}
        console.print(_table("subjects", frame.to_dict("records"), formats))
        findings = check_study(read)
        for finding in findings:
            about = f"{finding.subject}: " if finding.subject else ""
            console.print(f"[yellow]warning[/yellow] {_safe(about + finding.message)}", highlight=False, soft_wrap=True)
        if not findings:
            console.print("no warnings")


def main() -> None:
    """Entry point of the `bayes-toe` command."""
    app()


# --- reading ------------------------------------------------------------------------------------------------------------------------


def _read(path: Path, intensity: float | None, equal_code: str | None, different_code: str | None, columns: str | None) -> Study:
    from bayes_toe.files import read_study
    from bayes_toe.read_options import ReadOptions, parse_columns

    mapping = {} if columns is None else parse_columns(columns)
    options = ReadOptions(intensity=intensity, equal_code=equal_code, different_code=different_code, columns=mapping)
    return read_study(path, options)


@contextmanager
def _problems_as_lines() -> Iterator[None]:
    """Our own errors as lines on standard error and exit code 2; anything else is a bug and shows its traceback."""
    try:
        yield
    except BayesToeError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt:
        typer.echo("interrupted: nothing was written", err=True)
        raise typer.Exit(130) from None


# --- printing -----------------------------------------------------------------------------------------------------------------------


def _console(quiet: bool) -> Console:
    from rich.console import Console

    # Not a terminal: a width that keeps a table's row on one line, so that logs can be searched.
    return Console(quiet=quiet, width=None if sys.stdout.isatty() else 140)


def _safe(text: object) -> str:
    """Text from outside, kept from being read as markup."""
    from rich.markup import escape

    return escape(str(text))


@contextmanager
def _progress(console: Console, what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on a terminal, nothing elsewhere."""
    from rich.progress import Progress

    with Progress(console=console, disable=not console.is_terminal or console.quiet, transient=True) as bar:
        task = bar.add_task(what, total=total)

        def tick(_: str) -> None:
            bar.advance(task)

        yield tick


def _table(title: str, rows: list[dict[Any, Any]], formats: Mapping[str, Callable[[Any], str]]) -> Any:
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold")
    for index, key in enumerate(rows[0]):
        table.add_column(str(key), justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(formats.get(key, _safe)(value) for key, value in row.items()))
    return table


def _say_study(console: Console, study: Study) -> None:
    label = " (synthetic)" if study.synthetic and "synthetic" not in study.source else ""
    trials = sum(subject.total_trials for subject in study)
    plural = "" if len(study) == 1 else "s"
    console.print(f"[bold]{_safe(study.source)}[/bold]{label}: {len(study)} subject{plural}, {trials} trials", highlight=False)
    for note in study.notes:
        console.print(f"  {_safe(note)}", highlight=False, soft_wrap=True)


def _say_draws(console: Console, draws: Draws) -> None:
    import numpy as np

    stats, missed = draws.group("sample_stats"), draws.not_converged
    rows = []
    for i, name in enumerate(draws.names):
        row: dict[Any, Any] = {"subject": name}
        for key in ("mu1", "gain", "sigma_p", "sigma_l", "q0"):
            low, middle, high = np.quantile(draws.values(name, key), [0.05, 0.5, 0.95])
            row[key] = f"{middle:.2f}" + (f" ({low:.2f}, {high:.2f})" if key in ("mu1", "gain") else "")
        row["min ESS"] = f"{float(stats['min_ess'][i]):.0f}"
        row["max R-hat"] = f"{float(stats['max_r_hat'][i]):.3f}"
        row["converged"] = "NO" if name in missed else "yes"
        rows.append(row)
    console.print(_table("posterior: medians (5 %, 95 %)", rows, {}))
    for name, shortfall in missed.items():
        console.print(f"[red]not converged[/red] {_safe(name)}: {_safe(shortfall)}", highlight=False, soft_wrap=True)
    if draws.attrs["left_out"]:
        console.print(_safe(draws.attrs["left_out"]), highlight=False, soft_wrap=True)


def _say_evidence(console: Console, table: EvidenceTable) -> None:
    from bayes_toe.report import verdict

    rows: list[dict[Any, Any]] = [
        {
            "subject": row.subject,
            "log evidence H1": _number(row.log_evidence_h1),
            "s.e.": _number(row.log_evidence_h1_se, 4),
            "log evidence H0": _number(row.log_evidence_h0),
            "log Bayes factor": _number(row.log_bayes_factor),
            "favours": verdict(row),
            "k-hat": _number(row.pareto_k),
            "Laplace": _number(row.log_bayes_factor_laplace),
        }
        for row in table
    ]
    console.print(_table("evidence: natural logs, H1 minus H0", rows, {}))
    about: dict[str, list[str]] = {}
    for row in table:
        for note in row.notes:
            about.setdefault(note, []).append(row.subject)
    for note, names in about.items():
        console.print(f"[yellow]note[/yellow] {_safe(', '.join(names))}: {_safe(note)}", highlight=False, soft_wrap=True)


def _say_asymmetry(console: Console, table: AsymmetryTable) -> None:
    rows: list[dict[Any, Any]] = []
    for row in table:
        shown: dict[Any, Any] = {"subject": row.subject, "comparisons": len(row.comparisons), "accuracy": f"{row.accuracy:.2f}"}
        one = row.maximal
        if one is not None:
            shown["maximal asymmetry"] = f"{one.asymmetry:+.2f} \u00b1 {one.asymmetry_se:.2f}"
            shown["at (r, c)"] = f"({one.s_weak:.3g}, {one.s_strong:.3g})"
            shown |= {"p": f"{one.p_value:.2g}", "p (Holm)": f"{one.p_adjusted:.2g}"}
            shown["P(q_cr > q_rc)"] = f"{one.probability_of_direction:.3f}"
        rows.append(shown)
    rows.sort(key=len, reverse=True)  # subjects without a comparison come last; the first row names the columns
    filled = [{**dict.fromkeys(rows[0], "-"), **row} for row in rows]
    console.print(_table("asymmetry: q(c, r) - q(r, c), largest of each subject", filled, {}))
    console.print(_safe(table.population().describe()), highlight=False, soft_wrap=True)
    for note in table.notes:
        console.print(f"[yellow]note[/yellow] {_safe(note)}", highlight=False, soft_wrap=True)


def _say_covariates(console: Console, tests: CovariateTable) -> None:
    rows: list[dict[Any, Any]] = [
        {
            "covariate": row.covariate,
            "outcome": row.outcome,
            "test": f"{row.test}: {row.groups}" if row.groups else row.test,
            "n": row.n,
            "difference or r": _number(row.difference_or_r, 3),
            "statistic": _number(row.statistic),
            "df": _number(row.df, 1),
            "p": _number(row.p_value, 3),
        }
        for row in tests
    ]
    console.print(_table("covariates: Welch's t or Pearson's r, not corrected for their number", rows, {}))
    for note in dict.fromkeys([*tests.notes, *(f"{row.covariate}, {row.outcome}: {row.note}" for row in tests if row.note)]):
        console.print(f"[yellow]note[/yellow] {_safe(note)}", highlight=False, soft_wrap=True)


def _say_fits(console: Console, table: FitTable) -> None:
    rows: list[dict[Any, Any]] = []
    for one in table:
        limits = one.bootstrap.intervals(table.level).tolist()
        cells = map(_with_interval, one.parameters.tolist(), limits)
        row: dict[Any, Any] = {"subject": one.subject, **dict(zip(("mu1", "sigma_p", "sigma_l", "q0"), cells, strict=True))}
        rows.append({**row, "log likelihood": f"{one.log_likelihood:.2f}", "at edge": one.at_edge})
    title = f"maximum likelihood ({100 * table.level:g} % percentile intervals of {table.replicates} bootstrap replicates)"
    console.print(_table(title, rows, {}))
    for one in table:
        for note in one.notes:
            console.print(f"[yellow]note[/yellow] {_safe(one.subject)}: {_safe(note)}", highlight=False, soft_wrap=True)


def _with_interval(value: float, limits: list[float]) -> str:
    from math import isnan

    if isnan(value):
        return "-"
    return f"{value:.2f}" + ("" if isnan(limits[0]) else f" ({limits[0]:.2f}, {limits[1]:.2f})")


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _exit_for(draws: Draws) -> None:
    if draws.not_converged:
        raise typer.Exit(NOT_CONVERGED)
