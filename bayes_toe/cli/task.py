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
from bayes_toe.cli.options import DrawCount, Overwrite, PriorFile, Quiet, Seed, SpreadsheetSafe, StudyFileOrExample, Workers

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior

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

    def require_files(self, *files: Path) -> None:
        """Refuse before the work what could not be written after it."""
        from bayes_toe.data.parquet import require_parquet
        from bayes_toe.data.whole_files import require_writable
        from bayes_toe.data.whole_folders import put_back

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

        require_folder(folder, products, overwrite=self.overwrite)

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


@dataclass(frozen=True, kw_only=True)
class ModelTask(WritingTask, PriorTask):
    """A command that computes with a model of every subject."""

    seed: Seed = None
    workers: Workers = None


@dataclass(frozen=True, kw_only=True)
class ModelTableTask(TableTask, ModelTask):
    """The same with tables."""


@dataclass(frozen=True, kw_only=True)
class SamplingTask(ModelTask):
    """A command that samples."""

    draws: DrawCount = 4000

    def require_room(self, place: Path, study: Study, prior: Prior, model: str = "predictive update", *, others: int = 0) -> None:
        """Refuse before the work draws that will not fit on the disk, with `others`: bytes a subject of what goes beside them."""
        from bayes_toe.data.places import require_room
        from bayes_toe.inference.draws import stored_bytes
        from bayes_toe.inference.sampling import SamplerSettings

        require_room(place, stored_bytes(study, prior, SamplerSettings(self.draws), model) + others * (len(study) + 1))


def leave_unless_whole(task: Task, failed: Mapping[str, str], missed: Mapping[str, str]) -> None:
    """Exit code 3 where some subject failed, which is said, or its draws did not converge, which was."""
    for name, reason in failed.items():
        terminal.say_note(task.console, f"{name}: {reason}", "left out", "red")
    if failed or missed:
        raise typer.Exit(INCOMPLETE)
