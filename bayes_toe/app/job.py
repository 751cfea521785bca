"""The studies of the web page. Each is a folder, and the page shows only what the folder holds.

`Job` is one study, `create_job` makes it, and `jobs` lists all.

A study is analysed by the command `bayes-toe run` in its folder. The process holds a lock of the
home folder, so that one study is analysed at a time, also after the server was started again.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from bayes_toe.arrays import Record
from bayes_toe.data.messages import quoted
from bayes_toe.data.read_table import TABLE_SUFFIXES
from bayes_toe.data.whole_files import write_whole
from bayes_toe.errors import InputError
from bayes_toe.result_store import count_stored, discard, is_locked
from bayes_toe.version import __version__

#: Files that a study may have. Files of the page have other names.
RESULTS = "results"
RECORD, _COMMAND, _LOG, _LOCK = "study", "command", "run.log", "lock"
#: Another version may read a file in another way.
_READING = f"reading-{__version__}"
_STORE = f"{RESULTS}.partial"
_LONGEST_NAME = 60  # characters of up to four bytes

#: The options of the page, which have the names of the command's, with the kind of their value.
_TEXTS = (
    *("equal_code", "different_code", "second_code", "first_code", "comparison_code", "correct"),
    *(
        "standard_interval",
        "subject_from",
        "decimal",
        "condition",
        "intensity",
        "unit",
        "sheet",
        "encoding",
        "reference",
        "wide",
    ),
)
_KINDS: dict[str, type] = {
    **dict.fromkeys(_TEXTS, str),
    **dict.fromkeys(("ignore", "missed", "swap", "exclude"), list),
    **dict.fromkeys(("columns", "where"), dict),
    "standard_first": bool,
}


@dataclass(frozen=True)
class Job:
    """A study of the page, in a folder of its own."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the folder, 16 hexadecimal digits."""
        return self.folder.name

    def record(self) -> Record:
        """Names of the files, the seed and the options."""
        record: Record = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
        return record

    def save_options(self, options: Mapping[str, Any]) -> None:
        """Store how the files are read; the former reading is no longer valid."""
        self.save_reading(None)
        self.write(RECORD, {**self.record(), "options": options})

    def save_reading(self, reading: Mapping[str, Any] | None) -> None:
        """Store what reading the files gave."""
        self.write(_READING, reading)

    def reading(self) -> Record | None:
        """The result of reading the files; None if they were not read with these options."""
        reading: Record | None = self._read(_READING)
        return reading

    def command(self) -> list[str]:
        """The words of the command that analyses the study, without the program's name."""
        record = self.record()
        words = ["run", *record["files"], "-o", RESULTS, "--seed", str(record["seed"])]
        return [*words, *option_words(record["options"])]

    def state(self) -> Record:
        """All that the page shows of the study."""
        log = self.folder / _LOG
        return {
            "id": self.name,
            **self.record(),
            "reading": self.reading(),
            "run": self.run_state(),
            "done": count_stored(self.folder / _STORE),
            "log": log.read_text(encoding="utf-8", errors="replace") if log.exists() else "",
            "command": shlex.join(["bayes-toe", *self.command()]),
        }

    def run_state(self) -> str:
        """Whether the study is 'running', 'stopped', 'done', or 'new' with these options."""
        if running(self.folder.parent)[0] == self.name:
            return "running"
        if self._read(_COMMAND) != self.command():
            return "new"
        return "done" if (self.folder / RESULTS / "report.html").is_file() else "stopped"

    def start(self) -> subprocess.Popen[bytes]:
        """Analyse the study in a process group of its own, from the finished subjects on.

        What the study had under other options is removed.

        Raises
        ------
        InputError
            If a study is analysed now, or a question about this one is open.
        """
        reading, words = self.reading(), self.command()
        if reading is None or reading["study"] is None:
            raise InputError("A question about the file is open")
        with _open_lock(self.folder.parent) as lock:
            if not is_locked(lock):
                raise InputError("Another study is being analysed. Wait for it, or stop it.")
            store = self.folder / _STORE
            if self._read(_COMMAND) != words:
                discard(store)
                shutil.rmtree(self.folder / RESULTS, ignore_errors=True)
            self.write(_COMMAND, words)
            resume = ["--resume"] if count_stored(store) else []
            with open(self.folder / _LOG, "wb") as log:
                process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "bayes_toe", *words, *resume],
                    cwd=self.folder,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                    pass_fds=[lock.fileno()],
                )
            lock.truncate(0)
            lock.write(f"{self.name} {process.pid}")
        return process

    def write_zip(self, file: IO[bytes]) -> None:
        """Write the results, the files of the study and the command that repeats the run."""
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in self.record()["files"]:
                archive.write(self.folder / name, name)
            for path in result_files(self.folder / RESULTS):
                archive.write(path, path.relative_to(self.folder).as_posix())
            archive.writestr("command.txt", self.state()["command"])

    def write(self, name: str, content: object) -> None:
        """Write a file of ours, whole or not at all."""
        write_whole(self.folder / name, json.dumps(content).encode())

    def _read(self, name: str) -> Any:
        """The content of a file of ours; None where there is none."""
        try:
            return json.loads((self.folder / name).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None


# --- The home folder ------------------------------------------------------------------------------


def create_job(home: Path, files: Sequence[tuple[str, bytes]]) -> Job:
    """Store the files of a study, each a name and its content, in a new folder.

    Raises
    ------
    InputError
        If there is no file, two have one name, or a name has another suffix.
    """
    names = [file_name(name) for name, _ in files]
    if not names or len({*names}) < len(names):
        raise InputError("A study is one file, or several files of different names.")
    job = Job(home / secrets.token_hex(8))
    job.folder.mkdir(mode=0o700)
    for name, (_, content) in zip(names, files, strict=True):
        (job.folder / name).write_bytes(content)
    record = {
        "files": sorted(names),
        "seed": secrets.randbelow(1_000_000),
        "options": {},
        "created": datetime.now().astimezone().isoformat(),
    }
    job.write(RECORD, record)
    return job


def file_name(path: str) -> str:
    """A name for a file from a browser: of one folder, without signs that mean something.

    Examples
    --------
    >>> file_name("../../a b?.csv"), file_name("-x.CSV")
    ('a b_.csv', 'x.CSV')
    """
    last = path.replace("\\", "/").rpartition("/")[2]
    stem, suffix = os.path.splitext(re.sub(r"[^\w .+()@-]", "_", last).lstrip(" .-"))
    if suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(
            f"{quoted(last)}: the page reads files whose names end in {', '.join(TABLE_SUFFIXES)}"
        )
    return f"{stem[:_LONGEST_NAME]}{suffix}"


def jobs(home: Path) -> list[Job]:
    """The studies of a home folder, the newest first."""
    unsorted = [Job(file.parent) for file in home.glob(f"*/{RECORD}")]
    return sorted(unsorted, key=lambda job: str(job.record()["created"]), reverse=True)


def result_files(results: Path) -> list[Path]:
    """The files of a results folder."""
    paths = results.rglob("*")
    return sorted(path for path in paths if path.is_file())


# --- Options --------------------------------------------------------------------------------------


def require_options(content: bytes) -> Record:
    """The options in a request.

    Raises
    ------
    InputError
        If it is no JSON, or a name or the kind of a value is unknown.
    """
    try:
        options = Record(json.loads(content))
    except (TypeError, ValueError):
        raise InputError("The options are no record") from None
    for name, value in options.items():
        texts = [*value, *value.values()] if isinstance(value, dict) else value
        has_other_kinds = isinstance(texts, list) and not {*map(type, texts)} <= {str}
        if type(value) is not _KINDS.get(name) or has_other_kinds:
            raise InputError(f"The option {name}, or its value, is unknown")
    return options


def option_words(options: Mapping[str, Any]) -> list[str]:
    """Options as they are typed, in one order.

    Examples
    --------
    >>> option_words({"columns": {"s1": "stim A"}, "second_code": "-1", "swap": ["S01:2"]})
    ['--columns', 's1=stim A', '--second-code', '-1', '--swap', 'S01:2']
    """
    words = []
    for name, value in sorted(options.items()):
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, dict):
            value = [f"{ours}={theirs}" for ours, theirs in sorted(value.items())]
        if name == "columns":
            value = ",".join(value)
        if isinstance(value, str):
            words += [option, value]
        elif isinstance(value, list):
            for text in value:
                words += [option, text]
        else:
            words.append(option)
    return words


# --- The run --------------------------------------------------------------------------------------


def running(home: Path) -> tuple[str, int]:
    """The study that is analysed now and its process group; '' and 0 where there is none."""
    with _open_lock(home) as lock:
        if is_locked(lock):
            return "", 0
        lock.seek(0)
        name, _, group = lock.read().partition(" ")
    return name, int(group or 0)


def end_group(group: int, number: signal.Signals) -> None:
    """Send a signal to the processes of a run."""
    if group:
        with suppress(ProcessLookupError):
            os.killpg(group, number)


def _open_lock(home: Path) -> IO[str]:
    return open(home / _LOCK, "a+", encoding="utf-8")
