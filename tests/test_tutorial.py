"""docs/tutorial.md: its commands run one after the other, on two of its subjects and with what makes them cheap added."""

import re
import shlex
from pathlib import Path

from commands import good

import bayes_toe

PAGE = Path(__file__).resolve().parents[1] / "docs" / "tutorial.md"
CHEAP = {
    "run": ["--draws", "500", "--pictures", "none", "--workers", "1"],
    "compare": ["--model", "symmetric", "--model", "predictive update", "--workers", "1"],
    "corner": ["--workers", "1"],
}
MADE = {
    "study.csv",
    "asymmetry.csv",
    "results",
    "compare.csv",
    "compare_parts.csv",
    "compare_models.csv",
    "corner",
    "methods.md",
    "methods.bib",
}


def test_the_tutorial_runs(tmp_path, three_models):
    first, *commands = map(shlex.split, re.findall(r"^```sh\n(.*?)\n```", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL))
    example = Path(bayes_toe.__file__).parent.parent / first[1]
    head, *rows = example.read_text(encoding="utf-8").splitlines()
    (tmp_path / first[2]).write_text("\n".join([head, *(row for row in rows if row[:4] in ("S06,", "S13,"))]) + "\n", encoding="utf-8")
    for program, command, *words in commands:
        assert program == "bayes-toe"
        good(command, *words, *CHEAP.get(command, ()), cwd=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} >= MADE
    assert "2 synthetic subjects" in (tmp_path / "methods.md").read_text(encoding="utf-8").replace("\n", " ")
