"""A command at work: what every command does besides its own subject, with the shared options that this takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from bayes_toe.cli import terminal
from bayes_toe.cli.options import (
    DrawCount,
    Engine,
    Overwrite,
    PriorFile,
    Processes,
    Quiet,
    Resume,
    Scheduler,
    Seed,
    SpreadsheetSafe,
    StudyFileOrExample,
)
from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior
    from bayes_toe.workers import Workers

INCOMPLETE = 3


@dataclass(frozen=True, kw_only=True)
class Task:
    """A command that prints."""

    quiet: Quiet = False

    @cached_property
    def console(self) -> Console:
        """Where everything is printed."""
        return terminal.new_console(self.quiet)

    def progress(self, what: str, total: int) -> AbstractContextManager[Callable[[str], None]]:
        """A progress bar; call what it gives once for each part that is done."""
        return terminal.progress_bar(self.console, what, total)


@dataclass(frozen=True, kw_only=True)
class WritingTask(Task):
    """A command that writes files or a folder."""

    overwrite: Overwrite = False
    inputs: tuple[Path, ...] = ()  # no option: the files that the command reads, see command.py

    def require_files(self, *files: Path) -> None:
        """Refuse before the work what could not be written after it, and what would take the place of a file that is read."""
        from bayes_toe.data.text_table import require_parquet
        from bayes_toe.data.whole_files import require_writable
        from bayes_toe.data.whole_folders import put_back

        self._require_unread(*files)
        for file in files:
            require_parquet(file)
            put_back(file.parent)
            require_writable(file, overwrite=self.overwrite)

    def together(self, *files: Path) -> AbstractContextManager[Path]:
        """A folder to write files to under their names, which appear all together or not at all."""
        from bayes_toe.data.whole_folders import whole_together

        return whole_together(*files, overwrite=self.overwrite)

    def require_folder(self, folder: Path, products: Sequence[str]) -> None:
        """The same for a folder and what it will hold."""
        from bayes_toe.data.whole_folders import require_folder

        self._require_unread(*(folder / name for name in products))
        require_folder(folder, products, overwrite=self.overwrite)

    def _require_unread(self, *files: Path) -> None:
        read = {path.resolve() for path in self.inputs}
        for file in files:
            if file.resolve() in read:
                raise InputError(f"{file}: this command reads that file, allowed: another --output, whose files leave it as it is")

    def say_written(self, what: str, *files: Path, seed: int | None = None, ending: str = "") -> None:
        """The seed and what was written."""
        names = ", ".join(map(terminal.safe, files))
        beginning = "" if seed is None else f"seed {seed}; "
        self.console.print(f"{beginning}{what} [bold]{names}[/bold]{ending}", highlight=False)


@dataclass(frozen=True, kw_only=True)
class TableTask(WritingTask):
    """A command that writes tables."""

    spreadsheet_safe: SpreadsheetSafe = False

    @property
    def saving(self) -> dict[str, bool]:
        """How tables are written."""
        return {"overwrite": self.overwrite, "spreadsheet_safe": self.spreadsheet_safe}


@dataclass(frozen=True, kw_only=True)
class PriorTask(Task):
    """A command that reads a study and a prior."""

    prior: PriorFile = None

    def read(self, study: StudyFileOrExample) -> tuple[Study, Prior]:
        """The study and the prior; the prior is read first, because it is the shorter file."""
        from bayes_toe.model.prior_file import preset_or_file
        from bayes_toe.model.study_prior import prior_for

        prior, read = preset_or_file(self.prior), study.read()
        return read, prior_for(read, prior)

    def opened(self, study: StudyFileOrExample) -> tuple[Study, Prior]:
        """The study and the prior, read and said."""
        read, prior = self.read(study)
        self.introduce(read, prior)
        return read, prior

    def introduce(self, study: Study, prior: Prior) -> None:
        """Say what everything below is about."""
        terminal.say_study(self.console, study)
        terminal.say_prior(self.console, prior)
        terminal.say_doubts(self.console, study, prior)


@dataclass(frozen=True, kw_only=True)
class SharedTask(WritingTask):
    """A command that shares its work among workers."""

    processes: Processes = None
    engine: Engine = "local"
    scheduler: Scheduler = None

    @cached_property
    def workers(self) -> Workers:
        """Processes of this machine, or those of a cluster, which is connected to here and said."""
        self._require_one_engine()
        if self.scheduler is None:
            return self.processes
        from bayes_toe.cluster import connect

        client = connect(self.scheduler)
        terminal.say(self.console, f"  workers: {len(client.nthreads())} at {terminal.safe(self.scheduler)}")
        return client

    def _require_one_engine(self) -> None:
        if self.engine not in ("local", "dask"):
            raise InputError(f"--engine {self.engine}: allowed: local, dask")
        if (self.engine == "dask") != (self.scheduler is not None):
            raise InputError("--engine dask and --scheduler tcp://HOST:PORT go together")
        if self.scheduler is not None and self.processes is not None:
            raise InputError(f"--workers {self.processes} is of --engine local: the workers of a cluster are those it has")


@dataclass(frozen=True, kw_only=True)
class ModelTask(SharedTask, PriorTask):
    """A command that computes with a model of every subject."""

    seed: Seed = None


@dataclass(frozen=True, kw_only=True)
class KeepingTask(ModelTask):
    """One that keeps what is finished until all is."""

    resume: Resume = False

    def partial(self, output: Path) -> Path:
        """The folder beside the output in which finished subjects are kept; what a stopped command has left there is not lost unasked."""
        from bayes_toe.data.places import shown
        from bayes_toe.errors import OutputError
        from bayes_toe.kept import discard, kept_in

        named = output if output.name not in ("", "..") else output.resolve()
        folder = named.with_name(f"{named.name}.partial")
        found = 0 if self.resume else kept_in(folder)
        if found and not self.overwrite:
            raise OutputError(
                f"{shown(folder)}: holds {found} results of a stopped command, go on with --resume or begin anew with --overwrite"
            )
        if found:
            discard(folder)
        return folder

    def say_taken(self, folder: Path) -> None:
        """What was not computed again."""
        from bayes_toe.data.unfinished import under_way

        standing = under_way.get(folder)
        if self.resume and standing is not None:
            self.console.print(
                f"{standing.taken} of {standing.jobs} {standing.what} taken from [bold]{terminal.safe(folder)}[/bold]", highlight=False
            )

    def finish(self, folder: Path, failed: Mapping[str, str]) -> None:
        """Remove what was kept; not where work was lost, which may be tried again."""
        from bayes_toe.kept import discard

        if not failed:
            discard(folder)


@dataclass(frozen=True, kw_only=True)
class KeepingTableTask(TableTask, KeepingTask):
    """The same with tables."""


@dataclass(frozen=True, kw_only=True)
class ModelTableTask(TableTask, ModelTask):
    """The same with tables."""


@dataclass(frozen=True, kw_only=True)
class SamplingTask(ModelTask):
    """A command that samples."""

    draws: DrawCount = 4000

    def copies_for(self, file: Path) -> int:
        """How often the draws will be on the disk, see :meth:`require_room`; a store that could not be written is refused."""
        from bayes_toe.data.stores import named_store
        from bayes_toe.inference.draws_store import require_library

        if not named_store(file):
            return 2
        require_library()
        return 3

    def require_room(
        self, place: Path, study: Study, prior: Prior, model: str = "predictive update", *, others: int = 0, copies: int = 2
    ) -> None:
        """Refuse before the work draws that will not fit on the disk, with `others`: bytes a subject of what goes beside them.

        Two copies, since the draws of each subject are kept until all are in one file; three for a store, which is written from that file.
        """
        from bayes_toe.data.places import require_room
        from bayes_toe.inference.draws import stored_bytes
        from bayes_toe.inference.sampling import SamplerSettings

        draws = stored_bytes(study, prior, SamplerSettings(self.draws), model)
        require_room(place, copies * draws + others * (len(study) + 1))


def leave_unless_whole(task: Task, failed: Mapping[str, str], missed: Mapping[str, str]) -> None:
    """Exit code 3 where some subject failed, which is said, or its draws did not converge, which was."""
    terminal.say_notes(task.console, (f"{name}: {reason}" for name, reason in failed.items()), "left out", "red")
    if failed or missed:
        raise typer.Exit(INCOMPLETE)
