"""What a folder holds, and blocks that fail: for tests of outputs."""

import json
from collections.abc import Callable
from pathlib import Path

from bayes_toe.data.whole_files import MANIFEST


def tree(folder: Path) -> dict[str, str]:
    """Every file below a folder with its text, every empty folder with none; the manifest left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and path.name != MANIFEST:
            found[name] = path.read_text(encoding="utf-8")
        elif path.is_dir() and not any(path.iterdir()):
            found[name + "/"] = ""
    return found


def manifest(folder: Path) -> list[str]:
    listed: list[str] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
    return listed


def failing(error: BaseException) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail
