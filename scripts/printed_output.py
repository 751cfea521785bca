"""Run the commands and programs of README and tutorial, and write what they print under them.

A comment `<!-- output of: COMMAND -->`, or `<!-- output of the program above -->`, stands before
each block of printed text. `<!-- output of: COMMAND, lines 4 to 11 -->` stands before a part.

Example: python scripts/printed_output.py
"""

import io
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = (ROOT / "README.md", ROOT / "docs" / "tutorial.md")
#: Files that the documents analyse, and where they come from.
STUDIES = {
    "study.csv": "example_study.csv",
    "same_different.csv": "example_same_different_study.csv",
}
PROGRAM = "the program above"
_BLOCK = re.compile(
    r"^```python\n(?P<program>.*?)^```$"
    r"|^<!-- output of:? (?P<source>.+?)(?:, lines (?P<first>\d+) to (?P<last>\d+))? -->\n"
    r"```text\n(?P<printed>.*?)^```$",
    flags=re.MULTILINE | re.DOTALL,
)


class Output(NamedTuple):
    """What a document states that a command or program prints, where, and what it prints now."""

    source: str
    stated: str
    span: tuple[int, int]
    printed: str


def copy_studies(folder: Path) -> None:
    """Copy the bundled studies under the names that the documents give them."""
    for name, bundled in STUDIES.items():
        shutil.copy(ROOT / "bayes_toe" / "data" / bundled, folder / name)


def outputs(text: str, run_command: Callable[[list[str]], str]) -> Iterator[Output]:
    """Run all that a document runs, in the working directory; programs share their names."""
    names: dict[str, object] = {}
    program_printed = ""
    for block in _BLOCK.finditer(text):
        program, source = block["program"], block["source"]
        if program is not None:
            with redirect_stdout(io.StringIO()) as out:
                exec(program, names)
            program_printed = out.getvalue()
        elif source == PROGRAM:
            yield Output(source, block["printed"], block.span("printed"), program_printed)
        else:
            printed = run_command(shlex.split(source)).lstrip("\n")
            if block["first"]:
                lines = printed.splitlines(keepends=True)
                printed = "".join(lines[int(block["first"]) - 1 : int(block["last"])])
            yield Output(source, block["printed"], block.span("printed"), printed)


def call(words: list[str]) -> str:
    """What a command prints; ours run in this process."""
    if words[0] != "bayes-toe":
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout
    from bayes_toe.cli.app import app

    with redirect_stdout(io.StringIO()) as out:
        app(words[1:], prog_name=words[0], standalone_mode=False)
    return out.getvalue()


def main() -> None:
    """Write the printed text of every document again."""
    for document in DOCUMENTS:
        text = document.read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            copy_studies(Path(folder))
            for output in reversed(list(outputs(text, call))):
                start, end = output.span
                text = text[:start] + output.printed + text[end:]
        document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
