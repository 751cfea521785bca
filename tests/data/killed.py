"""A process that is killed at every step of publishing, and at every step of putting back: run as a script, in an empty folder."""

import itertools
import os
import signal
import sys
from pathlib import Path

from bayes_toe.data.stores import SEAL
from bayes_toe.data.whole_folders import MANIFEST, require_folder, whole_folder

NAMES = ("table.csv", "corner", "new.csv", "p.zarr", "stale.zarr")
STORE = f'{{"attributes": {{"{SEAL}": ""}}}}'
OLD = {"table.csv": "1", "corner/a.png": "1", "corner/stale.png": "1", "mine.txt": "m"}
OLD |= {"p.zarr/zarr.json": STORE, "p.zarr/g/v/c/0": "1", "p.zarr/g/v/c/1": "1", "stale.zarr/zarr.json": STORE}
NEW = {"table.csv": "2", "corner/a.png": "2", "new.csv": "2", "corner/deep/b.png": "2", "mine.txt": "m"}
NEW |= {"p.zarr/zarr.json": STORE, "p.zarr/g/v/c/0": "2"}


def produce(files):
    with whole_folder("out", NAMES, overwrite=True) as folder:
        for name, text in files.items():
            if name != "mine.txt":
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_text(text)


def tree():
    """The files with their texts; without the empty one that tries whether a folder can be written to, which may outlive its process."""
    files = (path for path in Path("out").rglob("*") if path.is_file() and path.stat().st_size and path.name != MANIFEST)
    return {path.relative_to("out").as_posix(): path.read_text() for path in files}


def killing(real, count, step):
    """A call that kills this process in its place, if it is the step-th of all."""

    def call(*given, **more):
        if next(count) == step:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*given, **more)

    return call


def killed_at(step, action):
    """Whether an action in a process of its own was killed before its step-th call that changes a folder, or ended before that."""
    child = os.fork()
    if child == 0:
        count = itertools.count()
        for name in ("replace", "rename", "link", "unlink", "mkdir", "rmdir"):
            setattr(os, name, killing(getattr(os, name), count, step))
        action()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def put_back():
    require_folder("out", NAMES, overwrite=True)


def check(*steps):
    """Killed at these steps, the first of publishing, the others of putting back; whether none was beyond the end."""
    import shutil

    shutil.rmtree("out", ignore_errors=True)
    produce(OLD)
    Path("out/mine.txt").write_text("m")
    reached = killed_at(steps[0], lambda: produce(NEW)) and all([killed_at(step, put_back) for step in steps[1:]])
    put_back()
    assert tree() in (OLD, NEW), (steps, tree())
    assert {path.name for path in Path("out").iterdir() if path.is_dir()} - {"stale.zarr"} == {"corner", "p.zarr"}, steps
    return reached


def no_link(*_, **__):
    raise OSError(1, "Operation not permitted")


if __name__ == "__main__":
    if "no links" in sys.argv:
        os.link = no_link
    single = next(step for step in itertools.count() if not check(step))
    pairs = 0
    for first in range(0, single, int(sys.argv[1])):
        pairs += next(second for second in itertools.count() if not check(first, second))
    print(single, pairs)
