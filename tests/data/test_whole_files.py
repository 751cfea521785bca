"""A file appears whole or not at all, and nobody else's files are touched."""

import os
import re
import tempfile

import pytest
from conftest import each_row, refused

from bayes_toe.data.whole_files import (
    require_folder,
    require_writable,
    whole_file,
    whole_folder,
)
from bayes_toe.errors import OutputError

NAMES = ("table.csv", "corner")
POSIX = pytest.mark.skipif(
    os.name == "nt",
    reason="links need rights on Windows, and processes are asked for as POSIX does",
)


def create_files(folder, files):
    """Write files such as `a.csv=text`, and make folders such as `corner/`."""
    for file in files.split():
        name, _, text = file.partition("=")
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if name.endswith("/"):
            path.mkdir()
        else:
            path.write_text(text)


def files_and_texts(folder):
    """Every file below a folder with its text, and every empty folder, such as `a.csv=text b/`."""
    files = []
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file():
            files.append(f"{name}={path.read_text()}")
        elif path.is_dir() and not any(path.iterdir()):
            files.append(f"{name}/")
    return " ".join(files)


def function_that_raises(error):
    def fail():
        raise error

    return fail


#: Called during the work, which must not begin.
BEFORE_WORK = function_that_raises(AssertionError("must be refused before any work"))


def write_whole(path, text, *, overwrite=False, meanwhile=int):
    """Write a text as a whole file; `meanwhile` is called before the file takes its place."""
    with whole_file(path, overwrite=overwrite) as temporary:
        temporary.write_text(text)
        meanwhile()


def write_whole_folder(path, files, *, overwrite=False, names=NAMES, meanwhile=int):
    """Write files as a whole folder; `meanwhile` is called before the folder takes its place."""
    with whole_folder(path, names, overwrite=overwrite) as folder:
        create_files(folder, files)
        meanwhile()


def test_the_check_before_the_work_leaves_nothing(tmp_path):
    # The check makes folders to see whether it may, and removes them.
    require_writable(tmp_path / "new/deep/fit.nc", overwrite=False)
    require_folder(tmp_path / "new/out", NAMES, overwrite=False)
    assert files_and_texts(tmp_path) == ""


@pytest.mark.parametrize("earlier_files", ["", "new/deep/fit.nc=old"])
def test_a_file_appears_when_it_is_complete(earlier_files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    create_files(tmp_path, earlier_files)
    with whole_file("new/deep/fit.nc", overwrite=True) as temporary:
        # The work writes another file of the same name, and an earlier file stays until the end.
        assert not temporary.exists()
        assert temporary.name == "fit.nc"
        temporary.write_text("whole")
        assert earlier_files in files_and_texts(tmp_path)
    assert files_and_texts(tmp_path) == "new/deep/fit.nc=whole"


def test_a_file_that_exists_or_appears_meanwhile_is_kept(tmp_path):
    # The file a.csv and a link to nowhere exist before the work, and b.csv appears during it.
    create_files(tmp_path, "a.csv=mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("a.csv", "link"):
        with refused(rf"{name}: exists; overwrite=True replaces it$", OutputError):
            write_whole(tmp_path / name, "new", meanwhile=BEFORE_WORK)
    with refused(r"b\.csv: exists", OutputError):
        write_whole(
            tmp_path / "b.csv", "new", meanwhile=lambda: create_files(tmp_path, "b.csv=theirs")
        )
    assert files_and_texts(tmp_path) == "a.csv=mine b.csv=theirs"


@pytest.mark.parametrize("error", [ValueError(), KeyboardInterrupt()], ids=repr)
def test_failure_leaves_everything_as_it_was(tmp_path, error):
    # The work fails or is interrupted when half is written. First it writes a file in the place of
    # another file, and a file in a new folder; then a folder in the place of another folder, and a
    # new folder.
    earlier_files = "b=old new/theirs=x out/corner/a.png=1 out/table.csv=1"
    create_files(tmp_path, earlier_files)
    for name in ("b", "new/deep/a.csv"):
        with pytest.raises(type(error)):
            write_whole(
                tmp_path / name, "half", overwrite=True, meanwhile=function_that_raises(error)
            )
    for name in ("out", "new/out"):
        with pytest.raises(type(error)):
            write_whole_folder(
                tmp_path / name,
                "table.csv=2",
                overwrite=True,
                meanwhile=function_that_raises(error),
            )
    assert files_and_texts(tmp_path) == earlier_files


#: Impossible names of files, and a part of the refusal.
IMPOSSIBLE_FILES = f"""
    folder | is a folder
    | is a folder
    file.txt/x.csv | cannot be written
    file.txt/deep/x.csv | cannot be written
    folder/{"x" * 5000} | cannot be written
"""
#: Impossible names of folders, and a part of the refusal.
IMPOSSIBLE_FOLDERS = """
    file.txt | is a file, choose
    file.txt/x | cannot be written
"""


@each_row("name, reason", IMPOSSIBLE_FILES)
def test_an_impossible_file_is_one_line(tmp_path, name, reason):
    # Such as file.txt/x.csv, where file.txt is a file. An empty name is the folder itself.
    create_files(tmp_path, "folder/ file.txt=x")
    with refused(f"^[^\n]*{reason}[^\n]*$", OutputError):
        write_whole(tmp_path / name, "x", overwrite=True)
    with refused(f"^[^\n]*{reason}[^\n]*$", OutputError):
        require_writable(tmp_path / name, overwrite=False)
    assert files_and_texts(tmp_path) == "file.txt=x folder/"


@each_row("name, reason", IMPOSSIBLE_FOLDERS)
def test_an_impossible_folder_is_one_line(tmp_path, name, reason):
    # The name is the name of a file, or a path below a file.
    create_files(tmp_path, "file.txt=x")
    with refused(f"^[^\n]*{reason}[^\n]*$", OutputError):
        write_whole_folder(tmp_path / name, "table.csv=t")
    assert files_and_texts(tmp_path) == "file.txt=x"


def test_a_place_without_permission_is_one_line_before_the_work(tmp_path, monkeypatch):
    # Python may not make a temporary folder in tmp_path, where the folder `new` would be made.
    def mkdtemp(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkdtemp", mkdtemp)
    message = f"{tmp_path / 'new'}: cannot be written (Permission denied), choose another place"
    with refused(f"^{re.escape(message)}$", OutputError):
        require_folder(tmp_path / "new/out", (), overwrite=False)
    with refused(f"^{re.escape(message)}$", OutputError):
        write_whole(tmp_path / "new/a.csv", "x", meanwhile=BEFORE_WORK)
    assert files_and_texts(tmp_path) == ""


@POSIX
@pytest.mark.parametrize("name", ["pipe", "link", "/dev/null"])
def test_only_regular_files_are_replaced(name, tmp_path):
    # A pipe, a link to nowhere and a device are refused before the work begins.
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with refused("is a link, pipe or device", OutputError):
        write_whole(tmp_path / name, "new", overwrite=True, meanwhile=BEFORE_WORK)


@POSIX
def test_permissions_of_a_replaced_file_stay(tmp_path):
    # Only its owner may read and write the file: 600.
    path = tmp_path / "private.csv"
    path.write_text("old")
    path.chmod(0o600)
    write_whole(path, "new", overwrite=True)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o600


def test_content_is_on_the_disk_before_a_file_takes_its_name(tmp_path, monkeypatch):
    """First a single file is written, and then a folder of two files."""
    # Calls of both functions are noted, and os.replace still does its work.
    steps = []
    replace = os.replace
    monkeypatch.setattr(os, "fsync", lambda _: steps.append("fsync"))
    monkeypatch.setattr(os, "replace", lambda *paths: (steps.append("replace"), replace(*paths)))
    write_whole(tmp_path / "a.csv", "1")
    write_whole_folder(tmp_path / "out", "table.csv=1 corner/a.png=1")
    assert " ".join(steps) == "fsync replace fsync fsync replace"


# --- A folder -------------------------------------------------------------------------------------


def test_a_folder_appears_whole_and_files_of_the_user_stay(tmp_path):
    out, files = tmp_path / "new/out", "corner/a.png=a table.csv=t"
    exists_during_work = []
    write_whole_folder(out, files, meanwhile=lambda: exists_during_work.append(out.exists()))
    assert exists_during_work == [False]
    assert files_and_texts(out) == files

    create_files(out, "corner/mine.png=mine")
    write_whole_folder(out, "corner/a.png=b", overwrite=True)
    assert files_and_texts(out) == "corner/a.png=b corner/mine.png=mine"  # table.csv is gone

    # Another command has other names, and leaves files with any other name.
    write_whole_folder(out, "evidence.csv=1", names=["evidence.csv"])
    assert files_and_texts(out) == "corner/a.png=b corner/mine.png=mine evidence.csv=1"


#: Earlier files, and how the refusal lists them.
EXISTING = """
    table.csv= | table.csv
    corner/ | corner
    a= b= c= | a, b, c
    a= b= c= d= | a, b, c, ... and 1 more
"""


@each_row("earlier_files, names", EXISTING)
def test_existing_names_are_refused_before_any_work(tmp_path, earlier_files, names):
    # The command writes table.csv, corner, a, b, c and d. At most three names are listed.
    create_files(tmp_path, earlier_files)
    message = f"{tmp_path}: already holds {names}; overwrite=True replaces it"
    with refused(f"^{re.escape(message)}$", OutputError):
        write_whole_folder(tmp_path, "", names=[*NAMES, *"abcd"], meanwhile=BEFORE_WORK)
    assert files_and_texts(tmp_path) == earlier_files


def test_files_that_are_no_longer_written_go_and_all_others_stay(tmp_path):
    out = tmp_path / "out"
    names = (  # The work writes none of these files.
        "table.csv",  # goes
        "corner",  # stays, since another file is in this folder
        "corner/a.png",  # goes
        "folder.csv",  # stays, since it is a folder
        "link/a",  # stays, since it is a file of the user behind a link
    )
    create_files(tmp_path, "elsewhere/a=mine")
    create_files(out, "table.csv=1 corner/a.png=1 corner/b.png=1 folder.csv/")
    (out / "link").symlink_to(tmp_path / "elsewhere")
    write_whole_folder(out, "", names=names, overwrite=True)
    assert files_and_texts(tmp_path / "elsewhere") == "a=mine"

    (out / "link").unlink()
    assert files_and_texts(out) == "corner/b.png=1 folder.csv/"


def test_a_subfolder_goes_with_its_last_file(tmp_path):
    create_files(tmp_path, "corner/a.png=1")
    write_whole_folder(tmp_path, "table.csv=2", names=["corner/a.png"], overwrite=True)
    assert files_and_texts(tmp_path) == "table.csv=2"


def test_changes_by_others_during_the_work_are_errors_or_stay(tmp_path):
    # During the work somebody writes a file of the same name, which is an error, or a file of
    # another name, which stays, or removes the folder itself.
    files, their_file = "corner/a.png=new table.csv=new", "table.csv=theirs"
    with refused(r"table\.csv: exists", OutputError):
        write_whole_folder(tmp_path, files, meanwhile=lambda: create_files(tmp_path, their_file))
    assert files_and_texts(tmp_path) == their_file

    out = tmp_path / "out"
    write_whole_folder(out, "table.csv=1", meanwhile=lambda: create_files(out, "mine.txt=m"))
    assert files_and_texts(out) == "mine.txt=m table.csv=1"

    no_file = refused(r"(out|a\.csv): cannot be written \(No such file", OutputError)
    with no_file, whole_folder(out, NAMES, overwrite=True) as new_folder:
        new_folder.rmdir()
    with no_file, whole_file(tmp_path / "a.csv"):
        pass  # The work writes no file.
    assert files_and_texts(out) == "mine.txt=m table.csv=1"
