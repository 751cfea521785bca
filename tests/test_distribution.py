"""Constraints are versions of all that is required, and the citation is of this version."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PYTHONS = [
    words.rsplit(" ", 1)[1]
    for words in SETTINGS["project"]["classifiers"]
    if words.startswith("Programming Language")
]


def _required(extra):
    """The requirements of an extra, those of the extras that it names in their place."""
    for words in SETTINGS["project"]["optional-dependencies"][extra]:
        requirement = Requirement(words)
        if requirement.name == "bayes_toe":
            for other in requirement.extras:
                yield from _required(other)
        else:
            yield requirement


@pytest.mark.parametrize("python", PYTHONS)
def test_constraints_are_versions_of_all_that_is_required(python):
    lines = (ROOT / "constraints" / f"python{python}.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(
        line.replace("_", "-").lower().split("==") for line in lines if not line.startswith("#")
    )
    for requirement in [*map(Requirement, SETTINGS["project"]["dependencies"]), *_required("test")]:
        if requirement.marker is None or requirement.marker.evaluate({"python_version": python}):
            name = requirement.name.replace("_", "-").lower()
            assert requirement.specifier.contains(pinned[name]), requirement


def test_the_citation_is_that_of_this_version():
    """By lines: PyYAML is no requirement."""
    lines = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    message = dict(line.split(": ", 1) for line in lines if re.match(r"[a-z-]+: .", line))
    project = SETTINGS["project"]
    assert (message["version"], message["license"]) == (project["version"], project["license"])
    assert "CITATION.cff" in SETTINGS["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
