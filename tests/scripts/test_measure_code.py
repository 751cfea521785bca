"""The measures of the code: each counts what it says, on small files whose counts are known."""

import ast

import measure_code
import pytest


@pytest.fixture
def measured(tmp_path, monkeypatch):
    """Measure a folder `package` with some files, given by name."""
    monkeypatch.setattr(measure_code, "ROOT", tmp_path)

    def measure(**sources):
        folder = tmp_path / "package"
        folder.mkdir()
        for name, source in sources.items():
            (folder / f"{name}.py").write_text(source, encoding="utf-8")
        return measure_code.Measurement(folder)

    return measure


@pytest.mark.parametrize(
    "source, expected",
    [
        ("def f(): return 1", 1),
        ("def f(a): return 1 if a else 2", 2),
        ("def f(a, b, c): return a and b and c", 3),
        ("def f(a): return [x for x in a if x if x > 1]", 4),
        ("def f(a):\n if a:\n  return 1\n for x in a:\n  assert x", 4),
        ("def f():\n def g(a):\n  return a or 1\n return g", 2),
    ],
)
def test_complexity_counts_branches_in_expressions(source, expected):
    assert measure_code.complexity(ast.parse(source).body[0]) == expected


@pytest.mark.parametrize("name", ["one", "found", "_said", "KEPT", "kept_in", "is_known", "place"])
def test_filler_names(name):
    assert measure_code.is_filler(name)


@pytest.mark.parametrize("name", ["row", "n_found", "x", "_", "__all__", "known_rows", "s1"])
def test_names_that_say_something(name):
    assert not measure_code.is_filler(name)


@pytest.mark.parametrize(
    "measure, source, expected",
    [
        ("nodes", "a = 1", 5),
        ("long lines", f"a = '{'x' * 95}'\nb = '{'x' * 94}'", 1),
        ("complex functions", f"def f(a):\n return {'a or ' * 15}a", 1),
        ("complex functions", f"def f(a):\n return {'a or ' * 14}a", 0),
        ("comprehensions", "a = [x for x in y]", 1000 / 12),
        ("nested comprehensions", "a = [x for y in z for x in y]", 1),
        ("nested comprehensions", "a = [[x for x in y] for y in z]", 1),
        ("nested comprehensions", "a = [x for x in z]", 0),
        ("conditional expressions", "a = 1 if b else 2", 1000 / 9),
        ("filler names", "def table(found, row):\n    said = row", 50),
    ],
)
def test_measures(measured, measure, source, expected):
    assert measured(module=source).value(measure) == pytest.approx(expected)


@pytest.mark.parametrize(
    "other, expected",
    [
        ("from package.first import a", 1),
        ("def f():\n from package import first", 1),
        ("from elsewhere.first import a", 0),
        ("import json", 0),
    ],
)
def test_import_circles(measured, other, expected):
    measurement = measured(first="from package.second import b", second=other)
    assert measurement.value("import circles") == expected


def test_places_name_file_and_line(measured):
    measurement = measured(module="row = 1\nfound = 2")
    assert measurement.places["filler names"] == ["package/module.py:2: found"]


def test_what_is_over_its_limit_is_named(measured, capsys):
    measurement = measured(module="a = 1")
    assert measure_code.over_limits(measurement, {"files": 1, "nodes": 4}) == ["nodes"]
    *_, files, nodes = capsys.readouterr().out.splitlines()
    assert files.split() == ["files", "1", "1"]
    assert nodes.split() == ["nodes", "5", "4", "too", "high"]


def test_package_and_tests_have_the_same_measures():
    package, tests = measure_code.LIMITS.values()
    assert list(package) == list(tests)
