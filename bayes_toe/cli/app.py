"""The command line: parse, call, print. Our errors become one line per problem and exit code 2.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output, 3 done but some subject's draws did not converge or `calibrate` failed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.cli import terminal
from bayes_toe.cli.options import (
    Command,
    DrawCount,
    Overwrite,
    PriorFile,
    Quiet,
    Seed,
    StudyFile,
    StudyFileOrExample,
    Workers,
    as_command,
)

if TYPE_CHECKING:
    from bayes_toe.data.study import Study
    from bayes_toe.inference.draws import Draws
    from bayes_toe.model.prior import Prior

NOT_CONVERGED = 3

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in same/different judgements.\n\n"
    "[bold]Example[/bold]: bayes-toe run study.csv -o results",
)


def _command(function: Command) -> Command:
    app.command()(as_command(function))
    return function


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        from bayes_toe import __version__

        typer.echo(f"bayes-toe {__version__}")
        raise typer.Exit


@_command
def run(
    study: StudyFileOrExample,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Results folder.")] = Path("bayes_toe_results"),
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Posterior, summary, evidence table, corner plots and report of a study, in one folder.

    [bold]Example[/bold]: bayes-toe run study.csv -o results --seed 1
    """
    from bayes_toe.analysis import run as analyse
    from bayes_toe.analysis import settings_for
    from bayes_toe.cli.results_folder import PRODUCTS, write_results
    from bayes_toe.data.example import example_truth
    from bayes_toe.data.whole_folders import require_folder

    require_folder(output, PRODUCTS, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    terminal.say_smaller_models(console, read)
    settings = settings_for(draws=draws, seed=seed, prior=believed)
    with terminal.progress_bar(console, "sampling", len(read)) as tick:
        analysis = analyse(read, settings, workers=workers, progress=tick)
    terminal.say_draws(console, analysis.draws)
    terminal.say_evidence(console, analysis.evidence)
    truth = example_truth() if study.path is None else None
    with terminal.progress_bar(console, "drawing", len(read)) as tick:
        write_results(analysis, output, overwrite=overwrite, truth=truth, workers=workers, progress=tick)
    console.print(f"seed {settings.seed}; results in [bold]{terminal.safe(output)}[/bold]: {', '.join(PRODUCTS)}", highlight=False)
    _exit_for(analysis.draws)


@_command
def sample(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="posterior.nc", help="NetCDF file to write.")] = Path("posterior.nc"),
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Posterior draws of every subject, as NetCDF that ArviZ opens.

    [bold]Example[/bold]: bayes-toe sample study.csv -o posterior.nc --draws 10000 --seed 1
    """
    from bayes_toe.analysis import draw, settings_for
    from bayes_toe.data.whole_files import require_writable

    require_writable(output, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    terminal.say_smaller_models(console, read)
    settings = settings_for(draws=draws, seed=seed, prior=believed)
    with terminal.progress_bar(console, "sampling", len(read)) as tick:
        made = draw(read, settings, workers=workers, progress=tick)
    made.save(output, overwrite=overwrite)
    terminal.say_draws(console, made)
    console.print(f"seed {settings.seed}; draws in [bold]{terminal.safe(output)}[/bold]", highlight=False)
    _exit_for(made)


@_command
def evidence(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="evidence.csv", help="Table to write.")] = Path("evidence.csv"),
    seed: Seed = None,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Evidence of the predictive-update model (H1) against one free frequency per pair (H0).

    [bold]Example[/bold]: bayes-toe evidence study.csv -o evidence.csv --seed 1
    """
    from bayes_toe.analysis import evidence as compute
    from bayes_toe.data.whole_files import require_writable
    from bayes_toe.seeds import root_seed

    require_writable(output, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    root = root_seed(seed)
    with terminal.progress_bar(console, "evidence", len(read)) as tick:
        table = compute(read, seed=root, prior=believed, workers=workers, progress=tick)
    table.save(output, overwrite=overwrite)
    terminal.say_evidence(console, table)
    console.print(f"seed {root}; table in [bold]{terminal.safe(output)}[/bold]", highlight=False)


@_command
def compare(
    study: StudyFile,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="compare.csv", help="Table to write; NAME_models.csv (study) and NAME.png beside it."),
    ] = Path("compare.csv"),
    model: Annotated[list[str] | None, typer.Option("--model", help="Only this model; repeat for more. Default: the whole ladder.")] = None,
    seed: Seed = None,
    draws: DrawCount = 1000,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """A ladder of models for every subject: evidence, leave-one-out, checks, model probabilities; and model frequencies over subjects.

    [bold]Example[/bold]: bayes-toe compare study.csv -o compare.csv --seed 1
    """
    from bayes_toe.comparison.ladder_table import beside
    from bayes_toe.comparison.ladder_table import compare as compute
    from bayes_toe.data.whole_files import require_writable
    from bayes_toe.model.ladder import require_models
    from bayes_toe.plots.comparison import save_comparison
    from bayes_toe.plots.figure_files import picture_beside

    models, picture = require_models(model), picture_beside(output)
    for path in (output, beside(output), picture):
        require_writable(path, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    with terminal.progress_bar(console, "comparing", len(read) * len(models)) as tick:
        table = compute(read, models, prior=believed, draws=draws, seed=seed, workers=workers, progress=tick)
    table.save(output, overwrite=overwrite)
    save_comparison(table, picture, synthetic=read.synthetic, overwrite=overwrite)
    terminal.say_comparison(console, table)
    files = ", ".join(map(terminal.safe, (output, beside(output), picture)))
    console.print(f"seed {table.seed}; written: [bold]{files}[/bold]", highlight=False)


@_command
def sensitivity(
    study: StudyFile,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="sensitivity.csv", help="Table to write; the figure goes to NAME.png.")
    ] = Path("sensitivity.csv"),
    reach: Annotated[float, typer.Option("--reach", help="Scales of the prior are multiplied by factors from 1/REACH to REACH.")] = 4.0,
    steps: Annotated[int, typer.Option("--steps", help="Values of each, an odd number.")] = 9,
    seed: Seed = None,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """At which prior a conclusion would turn: evidence and posteriors over a range of prior scales.

    [bold]Example[/bold]: bayes-toe sensitivity study.csv -o sensitivity.csv --seed 1
    """
    from bayes_toe.comparison.prior_sensitivity import require_range
    from bayes_toe.comparison.prior_sensitivity import sensitivity as compute
    from bayes_toe.data.whole_files import require_writable
    from bayes_toe.plots.figure_files import picture_beside
    from bayes_toe.plots.sensitivity import save_sensitivity

    picture = picture_beside(output)
    require_range(reach, steps)
    for path in (output, picture):
        require_writable(path, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    with terminal.progress_bar(console, "re-weighting", len(read)) as tick:
        table = compute(read, prior=believed, reach=reach, steps=steps, seed=seed, workers=workers, progress=tick)
    table.save(output, overwrite=overwrite)
    save_sensitivity(table, picture, synthetic=read.synthetic, overwrite=overwrite)
    terminal.say_sensitivity(console, table)
    files = ", ".join(map(terminal.safe, (output, picture)))
    console.print(f"seed {table.seed}; written: [bold]{files}[/bold]", highlight=False)


@_command
def asymmetry(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="asymmetry.csv", help="Table to write.")] = Path("asymmetry.csv"),
    covariates: Annotated[
        Path | None,
        typer.Option("--covariates", metavar="FILE.csv", help="Columns subject and one per covariate; tests go to NAME_covariates.csv."),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Time-order asymmetry of every comparison without a model: size, exact test, direction.

    [bold]Example[/bold]: bayes-toe asymmetry study.csv -o asymmetry.csv --covariates people.csv
    """
    from bayes_toe.classical.asymmetry import asymmetry as compute
    from bayes_toe.classical.covariates import covariate_tests, read_covariates
    from bayes_toe.data.whole_files import require_writable

    beside = output.with_name(f"{output.stem}_covariates.csv")
    for path in [output] if covariates is None else [output, beside]:
        require_writable(path, overwrite=overwrite)
    people = None if covariates is None else read_covariates(covariates)
    read = study.read()
    console = terminal.new_console(quiet)
    terminal.say_study(console, read)
    table = compute(read)
    tests = None if people is None else covariate_tests(people, table.outcomes())
    table.save(output, overwrite=overwrite)
    terminal.say_asymmetry(console, table)
    if tests is not None:
        tests.save(beside, overwrite=overwrite)
        terminal.say_covariates(console, tests)
    files = [output] if tests is None else [output, beside]
    console.print(f"written: [bold]{', '.join(map(terminal.safe, files))}[/bold]", highlight=False)


@_command
def fit(
    study: StudyFile,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="fit.csv", help="Table to write.")] = Path("fit.csv"),
    replicates: Annotated[int, typer.Option("--replicates", min=1, max=10**6, help="Bootstrap replicates a subject.")] = 1000,
    level: Annotated[float, typer.Option("--level", help="Level of the bootstrap intervals, between 0 and 1.")] = 0.95,
    seed: Seed = None,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Maximum-likelihood fit of every subject, as in the paper, with percentile bootstrap intervals.

    [bold]Example[/bold]: bayes-toe fit study.csv -o fit.csv --seed 1
    """
    from bayes_toe.classical.bootstrap import require_level
    from bayes_toe.classical.fit_table import fit as compute
    from bayes_toe.data.whole_files import require_writable

    require_level(level)
    require_writable(output, overwrite=overwrite)
    read, believed = _opened(study, prior)
    console = terminal.new_console(quiet)
    terminal.say_study(console, read)
    terminal.say_penalty(console, believed)
    with terminal.progress_bar(console, "fitting", len(read)) as tick:
        table = compute(read, replicates=replicates, level=level, seed=seed, prior=believed, workers=workers, progress=tick)
    table.save(output, overwrite=overwrite)
    terminal.say_fits(console, table)
    console.print(f"seed {table.seed}; table in [bold]{terminal.safe(output)}[/bold]", highlight=False)


@_command
def figures(
    study: StudyFileOrExample,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the figures.")] = Path("figures"),
    subject: Annotated[
        list[str] | None,
        typer.Option("--subject", help="In Figs. 3 and 5, the first also in Fig. 2; repeat for more. Default: three kinds."),
    ] = None,
    formats: Annotated[list[str] | None, typer.Option("--format", help="pdf, png or svg; repeat for more. Default: pdf and png.")] = None,
    seed: Seed = None,
    draws: DrawCount = 4000,
    workers: Workers = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """The paper's figures of a study, with captions: 1C, 2 to 6 and Appendix C's.

    [bold]Example[/bold]: bayes-toe figures study.csv -o figures --subject S06 --subject S04 --seed 1
    """
    from bayes_toe.analysis import run as analyse
    from bayes_toe.analysis import settings_for
    from bayes_toe.data.study import refuse_intervals
    from bayes_toe.data.whole_folders import require_folder
    from bayes_toe.plots.paper_figures import FIGURES, products, require_subjects, write_figures

    chosen = ["pdf", "png"] if formats is None else formats
    require_folder(output, products(chosen), overwrite=overwrite)
    read, believed = _opened(study, prior)
    refuse_intervals(read, "the paper's figures")  # before the sampling
    if subject is not None:
        require_subjects(subject, read.names)
    console = terminal.console_for(read, believed, quiet)
    settings = settings_for(draws=draws, seed=seed, prior=believed)
    with terminal.progress_bar(console, "sampling", len(read)) as tick:
        analysis = analyse(read, settings, workers=workers, progress=tick)
    terminal.say_draws(console, analysis.draws)
    with terminal.progress_bar(console, "drawing", len(FIGURES)) as tick:
        write_figures(analysis, output, subjects=subject, formats=chosen, overwrite=overwrite, workers=workers, progress=tick)
    console.print(f"seed {settings.seed}; figures and captions in [bold]{terminal.safe(output)}[/bold]", highlight=False)
    _exit_for(analysis.draws)


@_command
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
    from bayes_toe.cli.results_folder import corner_files, draw_corners, write_corners
    from bayes_toe.data.whole_folders import require_folder, whole_folder
    from bayes_toe.inference.draws import load

    loaded = load(posterior)
    chosen = loaded.names if subject is None else (loaded.select(subject).names[0],)
    files = corner_files(loaded, chosen)
    require_folder(output, list(files.values()), overwrite=overwrite)
    console = terminal.new_console(quiet)
    with terminal.progress_bar(console, "drawing", len(chosen)) as tick:
        pictures = draw_corners(loaded, chosen, coordinates=coordinates, workers=workers, progress=tick)
    with whole_folder(output, list(files.values()), overwrite=overwrite) as target:
        write_corners(pictures, target, files)
    console.print(f"{len(files)} corner plot{'' if len(files) == 1 else 's'} in [bold]{terminal.safe(output)}[/bold]", highlight=False)


@_command
def predict(
    posterior: Annotated[Path, typer.Argument(metavar="posterior.nc", help="Draws written by run or sample.")],
    pairs: Annotated[Path, typer.Argument(metavar="PAIRS.csv", help="Columns s1,s2, and isi (seconds) where the study has intervals.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="predictions.csv", help="Table to write.")] = Path("predictions.csv"),
    subject: Annotated[str | None, typer.Option("--subject", help="Only this subject.")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Posterior of P(equal), mean and quantiles, for pairs and intervals that need not have been tested.

    [bold]Example[/bold]: bayes-toe predict posterior.nc pairs.csv -o predictions.csv
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_files import require_writable
    from bayes_toe.inference.draws import load
    from bayes_toe.inference.prediction import predict_pairs

    require_writable(output, overwrite=overwrite)
    loaded = load(posterior)
    table = predict_pairs(loaded, pairs, loaded.names if subject is None else (subject,))
    write_table(table, output, overwrite=overwrite)
    console = terminal.new_console(quiet)
    console.print(f"{len(table)} predictions in [bold]{terminal.safe(output)}[/bold]", highlight=False)


@_command
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="STUDY.csv", help="Trials to write.")],
    truth: Annotated[Path | None, typer.Option("--truth", metavar="truth.csv", help="Where to write the true parameters.")] = None,
    subjects: Annotated[int, typer.Option("--subjects", min=1, help="How many, unless --population names a file.")] = 16,
    batches: Annotated[int, typer.Option("--batches", min=1, help="Repetitions of the whole set of pairs.")] = 50,
    amplitudes: Annotated[
        str, typer.Option("--amplitudes", help="Stimuli in units of the reference, weakest first.")
    ] = "1,1.15,1.36,1.55,1.66",
    design: Annotated[
        str, typer.Option("--design", help="reference (the paper's), full (all ordered pairs), or a CSV with s1,s2 (and isi).")
    ] = "reference",
    isi: Annotated[str | None, typer.Option("--isi", help="Inter-stimulus intervals in seconds, e.g. 0.5,1,2: every pair at each.")] = None,
    population: Annotated[str, typer.Option("--population", help="paper, prior, or a CSV with subject,mu1,sigma_p,sigma_l,q0.")] = "paper",
    seed: Seed = None,
    prior: PriorFile = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """A synthetic study for any design, population and seed.

    [bold]Example[/bold]: bayes-toe simulate -o study.csv --truth truth.csv --subjects 8 --seed 1
    """
    from bayes_toe.data.tables import write_table
    from bayes_toe.data.whole_files import require_writable
    from bayes_toe.experiments.recipes import design_from, population_from, trial_frame, truth_frame
    from bayes_toe.experiments.simulate import simulate_trials
    from bayes_toe.model.prior_file import prior_or_default
    from bayes_toe.seeds import root_seed

    for path in [output] if truth is None else [output, truth]:
        require_writable(path, overwrite=overwrite)
    believed = prior_or_default(prior)
    root = root_seed(seed)
    chosen = design_from(design, amplitudes, batches, isi)
    names, observers = population_from(population, subjects, root, prior=None if prior is None else believed)
    trials = simulate_trials(names, observers, chosen, root)
    write_table(trial_frame(trials), output, overwrite=overwrite)
    if truth is not None:
        write_table(truth_frame(names, observers), truth, overwrite=overwrite)
    total = sum(len(one.equal) for one in trials)
    console = terminal.new_console(quiet)
    console.print(
        f"{len(names)} synthetic subjects, {total} trials in [bold]{terminal.safe(output)}[/bold]; seed {root}",
        highlight=False,
    )


@_command
def calibrate(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables, figures and verdict.")],
    studies: Annotated[int, typer.Option("--studies", min=0, help="Studies a design for the ranks; 0 leaves them out.")] = 1000,
    data_sets: Annotated[int, typer.Option("--data-sets", min=0, help="Data sets a design for the evidence; 0 leaves it out.")] = 2000,
    seed: Seed = None,
    workers: Workers = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Whether posteriors and evidences are calibrated, on simulated data of known origin.

    [bold]Example[/bold]: bayes-toe calibrate -o calibration --studies 200 --data-sets 0 --seed 1
    """
    from bayes_toe.cli.calibration_folder import PRODUCTS, write_calibration
    from bayes_toe.data.whole_folders import require_folder
    from bayes_toe.experiments.calibration import Plan, simulate_and_analyse
    from bayes_toe.experiments.calibration_table import judge
    from bayes_toe.seeds import root_seed

    plan = Plan(studies, data_sets, root_seed(seed))
    require_folder(output, PRODUCTS, overwrite=overwrite)
    console = terminal.new_console(quiet)
    with terminal.progress_bar(console, "simulating and analysing", plan.total) as tick:
        table = judge(simulate_and_analyse(plan, workers=workers, progress=tick))
    write_calibration(table, output, overwrite=overwrite)
    terminal.say_calibration(console, table)
    console.print(f"seed {plan.seed}; results in [bold]{terminal.safe(output)}[/bold]", highlight=False)
    if not table.passed:
        raise typer.Exit(NOT_CONVERGED)


@_command
def check(
    study: StudyFile,
    prior: PriorFile = None,
    quiet: Quiet = False,
) -> None:
    """What was read, and what cannot be learnt from it, before any sampling.

    [bold]Example[/bold]: bayes-toe check study.csv --prior prior.toml
    """
    from bayes_toe.experiments.checks import check_study, describe

    read, believed = _opened(study, prior)
    console = terminal.console_for(read, believed, quiet)
    frame = describe(read)
    formats: dict[str, Callable[[Any], str]] = {"fraction_equal": lambda value: f"{value:.3f}"}
    console.print(terminal.table_of("subjects", frame.to_dict("records"), formats))
    findings = check_study(read)
    terminal.say_findings(console, findings)
    if not findings:
        console.print("no warnings")


def main() -> None:
    """Entry point of the `bayes-toe` command."""
    try:
        app()
    finally:
        _leave()


def _leave() -> None:
    """End without delay: on its way out Python looks through every object of the libraries for cycles, several times; once will do."""
    import gc

    from bayes_toe.workers import stop_workers

    stop_workers()
    gc.collect()
    gc.freeze()


def _opened(study: StudyFile, prior: Path | None) -> tuple[Study, Prior]:
    """The study and the prior that a command was given; the prior is read first, because it is the shorter file."""
    from bayes_toe.model.prior_file import prior_or_default

    believed = prior_or_default(prior)
    return study.read(), believed


def _exit_for(draws: Draws) -> None:
    if draws.not_converged:
        raise typer.Exit(NOT_CONVERGED)
