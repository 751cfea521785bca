"""The studies of the web page. Each is a folder, and the page shows only what the folder holds.

`Job` is one study, `job_of` finds the study of some files, and `list_jobs` lists all studies.

A study is analysed by the command `bayes-toe run` in its folder. The process holds a lock in the
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
import unicodedata
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, NamedTuple

from bayes_toe.arrays import Record
from bayes_toe.data.messages import quoted
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.read_table import TABLE_SUFFIXES
from bayes_toe.data.whole_files import reporting, whole_folder, write_whole
from bayes_toe.errors import InputError
from bayes_toe.result_store import discard, stored_files

#: Files that a study may have. Files of the page have other names.
RESULTS = "results"
RECORD = "study"
_COMMAND = "command"
_LOG = "run.log"
_STORE = f"{RESULTS}.partial"
#: In the home folder, the lock of the run.
_LOCK = ".bayes_toe_app.lock"

#: The kind of value of each option of the page. The options of the command have the same names.
_KINDS: dict[str, type] = {"swap": list, "exclude": list}
for _name, _default in vars(ReadOptions()).items():
    _KINDS[_name] = {tuple: list, dict: dict, bool: bool}.get(type(_default), str)


@dataclass(frozen=True)
class Job:
    """A study of the page, in a folder of its own."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the folder, 16 hexadecimal digits."""
        return self.folder.name

    def record(self) -> Record:
        """The stored record of the study: names of the files, seed, options, date of storing.

        Raises
        ------
        InputError
            If the folder holds no study, or the record of the study is damaged.
        """
        # A damaged record may have any content, and raises one of these errors.
        with suppress(OSError, ValueError, TypeError, LookupError, RecursionError):
            record = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
            names = record["files"]
            is_complete = {"seed", "options", "created"}.issubset(record)
            # `file_name` leaves safe names as they are.
            has_good_names = names and list(map(file_name, names)) == names
            if is_complete and has_good_names and re.fullmatch("[0-9a-f]{16}", self.name):
                return record
        raise InputError(f"The folder {quoted(self.name)} holds no study, or a damaged one")

    def is_stored(self) -> bool:
        """Whether the folder holds a study that is not damaged."""
        try:
            self.record()
        except InputError:
            return False
        return True

    def store(self, files: Mapping[str, bytes]) -> None:
        """Store the files of a new study, or of a damaged one, with a record without options.

        A stored study stays, because its options may have been chosen since.
        """
        if self.is_stored():
            return
        record = {
            "files": sorted(files),
            "seed": secrets.randbelow(1_000_000),
            "options": {},
            "created": datetime.now().astimezone().isoformat(),
        }
        contents = {**files, RECORD: json.dumps(record).encode()}
        with whole_folder(self.folder, list(contents), overwrite=True) as folder:
            folder.chmod(0o700)  # for this user only
            for name, content in contents.items():
                (folder / name).write_bytes(content)

    def save_options(self, options: Mapping[str, Any]) -> None:
        """Store how the files are read."""
        self._write(RECORD, {**self.record(), "options": options})

    def command(self) -> list[str]:
        """The words of the command that analyses the study, without the program's name."""
        record = self.record()
        words = ["run", *record["files"], "-o", RESULTS, "--seed", str(record["seed"])]
        return [*words, *option_words(record["options"])]

    def state(self) -> Record:
        """All that the page shows of the study; `done` counts the results so far."""
        log = self.folder / _LOG
        return {
            "id": self.name,
            **self.record(),
            "run": self.run_state(),
            "folder": str(self.folder / RESULTS),
            "done": len(stored_files(self.folder / _STORE)),
            # What the run has printed.
            "log": log.read_text(encoding="utf-8", errors="replace") if log.exists() else "",
            "command": shlex.join(["bayes-toe", *self.command()]),
        }

    def run_state(self) -> str:
        """Whether the study is 'new', 'running', 'stopped', 'done', or 'changed' since its run."""
        run = present_run(self.folder.parent)
        if run is not None and run.study == self.name:
            return "running"

        command = self.command()  # refuses a damaged study
        command_of_run = self._last_command()
        if command_of_run is None:
            return "new"
        if command_of_run != command:
            return "changed"
        # The folder of results appears at the end of a run, with all its files.
        return "done" if (self.folder / RESULTS / "report.html").is_file() else "stopped"

    def start(self) -> subprocess.Popen[bytes]:
        """Start the run of the study; subjects that an earlier run finished are not repeated.

        Results of the study under other options are removed. The process of the run inherits the
        open file of the run's lock, and thereby holds the lock until the process ends.

        Raises
        ------
        InputError
            If a study is analysed now.
        """
        command = self.command()
        with _open_lock(self.folder.parent) as lock:
            if not take_lock(lock):
                raise InputError("Another study is being analysed. Wait for it, or stop it.")

            store = self.folder / _STORE
            if self._last_command() != command:
                discard(store)
                shutil.rmtree(self.folder / RESULTS, ignore_errors=True)
            self._write(_COMMAND, command)
            resume = ["--resume"] if stored_files(store) else []

            with open(self.folder / _LOG, "wb") as log:
                process = subprocess.Popen(
                    # With -P, no file of the folder is imported as a module.
                    [sys.executable, "-P", "-m", "bayes_toe", *command, *resume],
                    cwd=self.folder,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # so that Ctrl+C for the server does not reach it
                    pass_fds=[lock.fileno()],
                )
            try:
                lock.truncate(0)
                json.dump(Run(self.name, process.pid, os.getpid()), lock)
                lock.flush()
            except OSError:  # Without its number in the lock, nobody could stop the process.
                end_group(process.pid, signal.SIGKILL)
                raise
        return process

    def _write(self, name: str, content: object) -> None:
        """Write a file of this module as JSON, whole or not at all."""
        write_whole(self.folder / name, json.dumps(content).encode())

    def _last_command(self) -> Any:
        """The words of the last run; None where there was none, or the file is damaged."""
        try:
            return json.loads((self.folder / _COMMAND).read_text(encoding="utf-8"))
        except (FileNotFoundError, ValueError):
            return None


# --- The home folder ------------------------------------------------------------------------------


def prepare_home(home: Path) -> None:
    """Make the home folder and the lock of its run, if they are missing.

    Raises
    ------
    OutputError
        If the home folder cannot be used, or if the lock is a link.
    """
    with reporting(home):
        home.mkdir(mode=0o700, parents=True, exist_ok=True)  # for this user only
        _open_lock(home).close()  # raises now, and not at the first run


def job_of(home: Path, files: Mapping[str, bytes]) -> Job:
    """The study of these files; its folder is named after their names and contents."""
    # Sorted, so that the order in which files are dropped does not matter.
    checksums = [[name, sha256(content).hexdigest()] for name, content in sorted(files.items())]
    return Job(home / _checksum(checksums)[:16])


def named_files(files: Sequence[tuple[str, bytes]]) -> dict[str, bytes]:
    """Contents by the names that the files get here.

    `files` has the path that the browser gives of each file, and its content.

    Raises
    ------
    InputError
        If there is no file, if two files get the same name, or if the program reads no files with
        the suffix of one.
    """
    contents = {}
    paths: dict[str, str] = {}
    for path, content in files:
        name = file_name(path)
        key = name.casefold()  # Some disks do not distinguish a.csv and A.csv.
        if key in paths:
            raise InputError(f"{paths[key]!r} and {path!r} get one name here. Rename one of them.")
        paths[key] = path
        contents[name] = content
    if not contents:
        raise InputError("A study is one file, or several files.")
    return contents


def file_name(path: str) -> str:
    """A safe name for a file from a browser: without folders, and without signs of shells.

    A long name is cut and gets a checksum, so that names with the same beginning stay different.

    Examples
    --------
    >>> file_name("../../a b?.csv"), file_name("-x.CSV"), file_name("e\u0301.csv")
    ('a b_.csv', 'x.CSV', 'é.csv')
    """
    # The part behind the last '/' or '\\'.
    last_part = unicodedata.normalize("NFC", path).replace("\\", "/").rpartition("/")[2]
    # At the start a '.' would hide the file, and a command would take a '-' for an option.
    stem, suffix = os.path.splitext(re.sub(r"[^\w .+()@-]", "_", last_part).lstrip(" .-"))
    if suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(
            f"{quoted(last_part)}: the page reads files whose names end in "
            f"{', '.join(TABLE_SUFFIXES)}"
        )
    if len(stem.encode()) > 120:  # Disks take names of 255 bytes, and hidden files add some.
        stem = f"{stem[:30]}-{_checksum(stem)[:8]}"
    return f"{stem}{suffix}"


def _checksum(value: object) -> str:
    """The SHA-256 of a value that JSON can hold, 64 hexadecimal digits."""
    return sha256(json.dumps(value).encode()).hexdigest()


def list_jobs(home: Path) -> tuple[list[Job], list[str]]:
    """The studies of a home folder, the newest first, and the names of its damaged studies.

    A study is damaged if its folder has a record that :meth:`Job.record` refuses.
    """
    studies = []
    damaged_names = []
    for file in home.glob(f"*/{RECORD}"):
        job = Job(file.parent)
        if job.is_stored():
            studies.append(job)
        else:
            damaged_names.append(job.name)
    studies.sort(key=lambda job: job.record()["created"], reverse=True)
    return studies, sorted(damaged_names)


# --- Options --------------------------------------------------------------------------------------


def require_options(content: bytes) -> Record:
    """The options by name, from a request with the JSON of such a record.

    Raises
    ------
    InputError
        If the content is no JSON, if an option is unknown, or if its value is of another kind.
    """
    try:
        options = Record(json.loads(content))
    except (TypeError, ValueError, RecursionError):
        raise InputError("The options are no record") from None
    for name, value in options.items():
        texts = []  # in the value; a value that is itself a text, or a flag, has none
        if isinstance(value, dict):
            texts = [*value, *value.values()]
        elif isinstance(value, list):
            texts = value
        are_texts = all(isinstance(text, str) for text in texts)
        if type(value) is not _KINDS.get(name) or not are_texts:
            raise InputError(f"The option {name}, or its value, is unknown")
    return options


def option_words(options: Mapping[str, Any]) -> list[str]:
    """Options as they are typed, in the order of their names.

    Examples
    --------
    >>> option_words({"columns": {"s1": "stim A"}, "second_code": "-1", "swap": ["S01:2"]})
    ['--columns', 's1=stim A', '--second-code', '-1', '--swap', 'S01:2']
    """
    words = []
    for name, value in sorted(options.items()):
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, bool):  # a flag, which has no value when it is typed
            if value:
                words.append(option)
            continue

        if isinstance(value, str):
            texts = [value]
        elif isinstance(value, list):
            texts = value
        else:  # `columns`, a column for each role, or `where`, a text for each column
            texts = [f"{key}={text}" for key, text in sorted(value.items())]
        if name == "columns":  # All columns are one text, so that the option is typed once.
            texts = [",".join(texts)]
        for text in texts:
            words += [option, text]
    return words


# --- The run --------------------------------------------------------------------------------------


class Run(NamedTuple):
    """The run that goes on: its study, its process group, and the process of its server.

    The lock of the run has them as JSON.
    """

    study: str
    group: int
    server: int


def present_run(home: Path) -> Run | None:
    """The run that goes on in a home folder; None if no study is analysed."""
    with _open_lock(home) as lock:
        if take_lock(lock):
            return None
        lock.seek(0)
        # The lock is empty while the process starts.
        return Run(*json.loads(lock.read() or '["", 0, 0]'))


def end_group(group: int, number: signal.Signals) -> None:
    """Send a signal to the processes of a run; `group` is 0 while the run starts."""
    if group:  # 0 would mean the group of this process
        with suppress(ProcessLookupError):
            os.killpg(group, number)


def is_alive(process: int) -> bool:
    """Whether this user has a process with this number."""
    try:
        os.kill(process, 0)  # no signal; it only asks whether one could be sent
    except OSError:
        return False
    return True


def _open_lock(home: Path) -> IO[str]:
    """Open the lock of the run in the home folder; a link is refused, and the content stays."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
    return open(os.open(home / _LOCK, flags, 0o666), "a+", encoding="utf-8")


def take_lock(lock: IO[str]) -> bool:
    """Take a lock, unless another process has it; return whether the lock was taken.

    The lock is free again when this process has closed the file of the lock, and so has each child
    process that inherited the file.
    """
    import fcntl  # here, because Windows has no such module

    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
