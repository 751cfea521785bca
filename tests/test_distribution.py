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


def requirements_of_extra(extra):
    """The requirements of an extra, with those of extras that it names, such as bayes_toe[app]."""
    for words in SETTINGS["project"]["optional-dependencies"][extra]:
        requirement = Requirement(words)
        if requirement.name == "bayes_toe":
            for other in requirement.extras:
                yield from requirements_of_extra(other)
        else:
            yield requirement


@pytest.mark.parametrize("python", PYTHONS)
def test_constraints_are_versions_of_all_that_is_required(python):
    # A line of the file is such as `numpy==2.1.0`. Each requirement for this Python has a version
    # there.
    lines = (ROOT / "constraints" / f"python{python}.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(
        line.replace("_", "-").lower().split("==") for line in lines if not line.startswith("#")
    )
    for requirement in [
        *map(Requirement, SETTINGS["project"]["dependencies"]),
        *requirements_of_extra("test"),
    ]:
        if requirement.marker is None or requirement.marker.evaluate({"python_version": python}):
            name = requirement.name.replace("_", "-").lower()
            assert requirement.specifier.contains(pinned[name]), requirement


def test_the_citation_is_that_of_this_version():
    # Lines such as `version: 0.1.0`. No library that reads YAML is required.
    lines = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    fields = dict(line.split(": ", 1) for line in lines if re.match(r"[a-z-]+: .", line))
    project = SETTINGS["project"]
    assert fields["version"] == project["version"]
    assert fields["license"] == project["license"]
    assert "CITATION.cff" in SETTINGS["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
