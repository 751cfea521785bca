"""`as_command` makes a command of a function; `RunContext` has the options that commands share.

A parameter that is a dataclass becomes one option for each field. Errors of input end the command
with exit code 2. `RunContext` reads the study, runs the work in parallel, stores finished subjects,
and checks and writes outputs.
"""

from __future__ import annotations

import inspect
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, wraps
from inspect import Parameter
from os.path import isfile
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args, get_type_hints

import typer

from bayes_toe.cli.options import (
    LAYOUT_OPTIONS,
    NO_FILE,
    NUMBER,
    DrawCount,
    StudyFile,
    Text,
    flag,
    layout_options,
    option,
    rare,
)
from bayes_toe.cli.terminal import WIDTH, Terminal, describe_study
from bayes_toe.data.messages import format_path, plural, visible
from bayes_toe.data.whole_files import describe_stored, under_way
from bayes_toe.errors import (
    BayesToeError,
    ConvergenceWarning,
    InputError,
    OutputError,
    OutputExistsError,
)

if TYPE_CHECKING:
    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior
    from bayes_toe.workers import Workers

Result = TypeVar("Result")
#: Fields of :class:`RunContext` that many commands have as options: commands with several
#: processes, and commands with a model. The annotation of a command names its fields. Every command
#: has `quiet`.
WORKERS = ("processes", "dask", "overwrite")
MODEL = ("seed", "prior", *WORKERS)


@dataclass(frozen=True)
class RunContext:
    """The shared options, in the order in which help lists them, and the files that are read."""

    seed: Annotated[
        int | None, option("--seed", NUMBER, "Random seed, printed and stored.", min=0)
    ] = None
    draws: DrawCount = 4000
    processes: Annotated[
        int | None, rare("--workers", NUMBER, "Processes (default: all cores).", min=1)
    ] = None
    dask: Annotated[Text, rare("--dask", "tcp://HOST:PORT", "Use a Dask cluster.")] = None
    prior: Annotated[Text, option("--prior", "PRIOR", "Prior: default, paper, or a TOML file.")] = (
        None
    )
    resume: Annotated[bool, flag("--resume", "Continue a stopped command.")] = False
    overwrite: Annotated[bool, flag("--overwrite", "Replace existing output.")] = False
    quiet: Annotated[bool, typer.Option("--quiet", "-q", metavar="", help="Print errors only.")] = (
        False
    )
    inputs: tuple[Path, ...] = ()

    # --- what is read -----------------------------------------------------------------------------

    def read_and_describe(
        self, file: StudyFile, *, several_tasks: bool = False
    ) -> tuple[Study, Prior]:
        """Read the study and the prior; print what was read, and probable mistakes in the study.

        The prior is read first, because it is the shorter file. It is printed if --prior names it.
        A study with several tasks is refused, unless the command compares them.
        """
        from bayes_toe.checks.design_checks import urgent_findings
        from bayes_toe.model.prior_file import preset_or_file, prior_for

        preset = preset_or_file(self.prior)
        study = file.read()
        if len(study.by_task) > 1 and not several_tasks:
            # The file is read again only for its error, which says what to type for each task.
            replace(file, reading={**file.reading, "condition": None}).read()
        prior = prior_for(study, preset)
        self.out.line(describe_study(study))
        if study.reading.options_found:
            self.out.line(f"Read with {study.reading.options_found}, as names and cells suggest")
        if study.changes:
            self.out.line(f"With {' '.join(study.changes)}")
        if self.prior == "paper":
            self.out.line("Prior: paper (of H1 alone; the four models keep their default prior)")
        elif self.prior is not None:
            self.out.line(f"Prior: {self.prior}")
        for part in study.by_task:
            self.out.findings(urgent_findings(part))
        return study, prior

    def print_uninterpretable(self, study: Study) -> None:
        """Print the subjects in use whose responses cannot be interpreted, with the reasons."""
        from bayes_toe.checks.answer_checks import uninterpretable_findings

        for part in study.by_task:
            self.out.findings(uninterpretable_findings(part))

    # --- the work ---------------------------------------------------------------------------------

    @cached_property
    def out(self) -> Terminal:
        """Where everything is printed."""
        return Terminal(self.quiet)

    def work(
        self, label: str, total: int, function: Callable[..., Result], *values: Any, **options: Any
    ) -> Result:
        """Call a function with these arguments, seed, workers and progress; return its result.

        The bar has `total` parts, which are subjects or data sets, and the function advances it.
        """
        with self.out.progress(label, total) as tick:
            return function(*values, seed=self.seed, workers=self.workers, progress=tick, **options)

    def draw(self, jobs: Sequence[Callable[[], Result]], names: Sequence[str]) -> list[Result]:
        """Draw figures in parallel, with a progress bar; return what the jobs return.

        `names` has the name of the subject or of the file of each job.
        """
        from bayes_toe.workers import local_processes, run_in_order

        with self.out.progress("drawing", len(jobs)) as tick:
            # `run_in_order` takes a tuple of names for each job, here with a single name.
            names_of_jobs = [(name,) for name in names]
            return run_in_order(jobs, local_processes(self.workers), tick, names_of_jobs)

    @cached_property
    def workers(self) -> Workers:
        """Processes of this machine, or a client of a Dask cluster."""
        if self.dask is None:
            return self.processes
        if self.processes is not None:
            raise InputError(f"--workers {self.processes} and --dask exclude each other.")
        from bayes_toe.cluster import connect

        client = connect(self.dask)
        self.out.line(f"Workers: {len(client.nthreads())} at {self.dask}")
        return client

    def partial_folder(self, output: Path) -> Path:
        """The folder beside the output for finished subjects.

        It may hold results of a stopped command, which --resume uses and --overwrite removes.
        Without either option an OutputError is raised.
        """
        from bayes_toe.result_store import discard, stored_files

        # '.' and '..' have no name to which an ending can be added.
        target = output if output.name not in ("", "..") else output.resolve()
        folder = target.with_name(f"{target.name}.partial")
        if self.resume:
            return folder
        n_stored = len(stored_files(folder))
        if n_stored and not self.overwrite:
            raise OutputError(
                f"{format_path(folder)} holds {plural(n_stored, 'result')} of a stopped command. "
                "--resume continues it, --overwrite starts again."
            )
        if n_stored:
            discard(folder)
        return folder

    def finish(self, folder: Path, failed: Mapping[str, str]) -> None:
        """Print how many results of a stopped command were used, and remove the stored results.

        If a subject failed, the results stay for another --resume.
        """
        from bayes_toe.result_store import discard

        stored = under_way.get(folder)  # set by the work, for each folder of stored results
        if self.resume and stored is not None:
            self.out.line(f"{stored.taken} of {len(stored.files)} subjects taken from {folder}")
        if not failed:
            discard(folder)

    # --- what is written --------------------------------------------------------------------------

    def require_files(self, *files: Path) -> None:
        """Refuse, before the work, outputs that cannot be written or that the command reads."""
        from bayes_toe.data.whole_files import require_writable

        self._require_unread(*files)
        paths = [file.resolve() for file in files]
        for file in files:
            if paths.count(file.resolve()) > 1:
                raise InputError(f"{file}: named for two outputs. Use two names.")
            require_writable(file, overwrite=self.overwrite)

    def require_folder(self, folder: Path, products: Sequence[str]) -> None:
        """Refuse, before the work, a folder whose products cannot be written or are read."""
        from bayes_toe.data.whole_files import require_folder

        self._require_unread(*(folder / name for name in products))
        require_folder(folder, products, overwrite=self.overwrite)

    def _require_unread(self, *files: Path) -> None:
        """Refuse to write a file that this command reads."""
        read = {path.resolve() for path in self.inputs}
        for file in files:
            if file.resolve() in read:
                raise InputError(
                    f"{file}: this command reads that file and must not replace it. "
                    "Use another --output."
                )

    def write(self, writers: Mapping[Path, Callable[[Path], object]], seed: int) -> str:
        """Write each file by its function; return a sentence that names the files and the seed.

        If a file cannot be written, no file is replaced.
        """
        from bayes_toe.data.whole_files import whole_file

        with ExitStack() as files:
            for file, write in writers.items():
                write(files.enter_context(whole_file(file, overwrite=self.overwrite)))
        return f"Written: {', '.join(map(str, writers))}. Seed {seed}."

    def print_written(self, text: str, seed: int | None = None) -> None:
        """Print what was written, and the seed."""
        self.out.line()
        self.out.line(f"{text}." if seed is None else f"{text}. Seed {seed}.")

    def end_with_problems(self, *problems: object) -> None:
        """End with exit code 3 if any of the `problems` is true; else do nothing.

        A problem is a truth value, or a record of subjects with reasons, which is false if it is
        empty. Problems are that subjects failed, or that their draws did not converge.
        """
        if any(problems):
            raise typer.Exit(3)


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """The function as the command line calls it.

    A parameter that is a record becomes one option for each of its fields, and the function
    receives the record. A :class:`RunContext` has options only for the fields that the annotation
    names. Our errors become lines on standard error and exit code 2. Any other exception is a bug
    and shows its traceback.
    """
    signature = inspect.signature(function, eval_str=True)
    record_types: dict[str, Any] = {}  # class and names of options, by the name of the parameter
    parameters = []
    for name, parameter in signature.parameters.items():
        # Annotated[RunContext, "seed"] has a class and names of fields; a class alone has no names.
        kind, *names = get_args(parameter.annotation) or [parameter.annotation]
        if is_dataclass(kind):
            options = _options(kind, names)
            record_types[name] = kind, [option.name for option in options]
            parameters += options
        else:  # an option already
            parameters.append(parameter)

    @wraps(function)
    def command(**values: Any) -> None:
        """Make the records of the values of options, and call the function with them."""
        inputs = _input_paths(values)  # files that outputs must not replace
        under_way.clear()  # An earlier call in this process may have stored results.
        try:
            # Each command has its study before the context, which gets the files of the study too.
            for name, (kind, option_names) in record_types.items():
                record = {key: values.pop(key) for key in option_names}
                if kind is RunContext:
                    record["inputs"] = inputs
                if kind is StudyFile:
                    record["reading"] = {key: record.pop(key) for key in LAYOUT_OPTIONS}
                values[name] = kind(**record)
                if kind is StudyFile:
                    inputs += values[name].data_files()
            with warnings.catch_warnings():
                # Every screen names what did not converge.
                warnings.simplefilter("ignore", ConvergenceWarning)
                function(**values)
        except BayesToeError as error:
            print_error(error, function.__name__)
            raise typer.Exit(2) from error

    # Typer reads the signature of a command, and makes an option of each parameter.
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return command


def _input_paths(values: Mapping[str, Any]) -> tuple[Path, ...]:
    """The files that a command reads: values of options that name a file, except outputs.

    Any option may name a file: the value of --prior is the name of a prior or of a file.
    """
    paths = []
    for name, value in values.items():
        if not name.endswith("output"):
            items = value if isinstance(value, list) else [value]
            paths += [Path(item) for item in items if isfile(str(item))]
    return tuple(paths)


def _options(kind: Any, names: Sequence[str]) -> list[Parameter]:
    """A parameter for each field of a class of records; a RunContext has only `names` and `quiet`.

    The field `reading` of a StudyFile has a parameter for each of the layout options.
    """
    hints = get_type_hints(kind, include_extras=True)
    options = []
    for field in fields(kind):
        is_absent = kind is RunContext and field.name not in (*names, "quiet")
        if is_absent or field.name == "reading":
            continue
        options.append(
            Parameter(
                field.name,
                Parameter.KEYWORD_ONLY,
                default=field.default,
                annotation=hints[field.name],
            )
        )
    if kind is StudyFile:
        options += layout_options()
    return options


def print_error(error: BayesToeError, command: str) -> None:
    """Print the problems of an error, then what to type, one choice a line."""
    choices = []  # texts to type, each with its meanings
    if isinstance(error, InputError):
        # The text of the error itself goes on with what to type in Python.
        text = "\n".join(error.problems)
        for remedies, meanings in error.choices:
            choices.append((" ".join(remedy.typed for remedy in remedies), meanings))
        if text == NO_FILE:  # an error without remedies, because the command is known only here
            choices = [(f"bayes-toe {command} {study}", []) for study in ("STUDY.csv", "--example")]
    elif isinstance(error, OutputExistsError):
        text = error.problem
        choices = [("--overwrite", ["to replace it"]), ("-o NAME", ["to write elsewhere"])]
    else:
        text = str(error)

    stored = describe_stored()
    if stored:
        text = f"{text}; {stored}"
    for line in text.split("\n"):
        print_labelled("error:", line)
    _print_choices(choices)


def _print_choices(choices: Sequence[tuple[str, Sequence[str]]]) -> None:
    """Print what can be typed, and what it means: 'type: --overwrite  to replace it'."""
    # Meanings begin in one column, behind the longest option, but not behind the 40th column.
    width = min(max((len(typed) for typed, _ in choices), default=0), 40)
    label = "type:"  # before the first choice
    for typed, meanings in choices:
        # A single meaning stands beside the option, several meanings below it.
        if len(meanings) == 1:
            print_labelled(label, f"{typed:<{width}}  {meanings[0]}".rstrip())
        else:
            print_labelled(label, typed)
            for meaning in meanings:
                print_labelled("", f"    {meaning}")
        label = ""  # Further choices have no label.


def print_labelled(label: str, text: str) -> None:
    """Print a text on standard error behind a label; a terminal gets lines of 80 columns."""
    text = visible(text)
    if sys.stderr.isatty():
        # The label takes 7 columns.
        lines = wrap(text, WIDTH - 7, break_long_words=False, break_on_hyphens=False)
    else:
        lines = [text]
    for line in lines:
        typer.echo(f"{label:<7}{line}", err=True)
        label = ""  # Further lines have no label.
