"""The measures of the code: each counts what it says, on small files whose counts are known."""

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


def test_what_is_over_its_limit_is_named(measured, capsys):
    measurement = measured(module="a = 1")
    assert measure_code.over_limits(measurement, {"files": 1, "nodes": 4}) == ["nodes"]
    *_, files, nodes = capsys.readouterr().out.splitlines()
    assert files.split() == ["files", "1", "1"]
    assert nodes.split() == ["nodes", "5", "4", "too", "high"]


def test_package_and_tests_have_the_same_measures():
    package, tests = measure_code.LIMITS.values()
    assert list(package) == list(tests)
