"""Commands that are killed, and go on: the same results to the bit, and nothing left of the way there."""

import pytest
from commands import good, refused
from conftest import few_pairs, grouped_csv, known_observers
from processes import needs_proc, start, until, until_gone

pytestmark = needs_proc


@pytest.fixture
def folder(tmp_path):
    """Four subjects with few pairs."""
    grouped_csv(tmp_path / "study.csv", few_pairs("ABCD"))
    return tmp_path


def killed(folder, *words, kept):
    """A command that is killed without warning when so many subjects are there."""
    running = start(*words, cwd=folder)
    until(lambda: len(list(folder.glob("*.partial/*.kept"))) >= kept, running)
    running.kill()
    running.communicate()
    until_gone(running.pid)


def test_a_command_that_is_killed_and_resumed_is_as_one_that_was_not(folder):
    options = ("--seed", "1", "--draws", "100", "--model", "symmetric", "--workers", "2")
    words = ("sample", "study.csv", "-o", "posterior.nc", *options)
    killed(folder, *words, kept=2)
    said = refused(*words, cwd=folder)
    if not (folder / "posterior.nc").exists():
        assert "go on with --resume or begin anew with --overwrite" in said
        assert "of 4 subjects taken from posterior.nc.partial" in good(*words, "--resume", cwd=folder)
    assert sorted(path.name for path in folder.iterdir()) == ["posterior.nc", "study.csv"]
    good("sample", "study.csv", "-o", "calm.nc", *options, cwd=folder)
    assert (folder / "posterior.nc").read_bytes() == (folder / "calm.nc").read_bytes()


def test_a_group_goes_on_with_the_subjects_that_were_done_before_it_was_killed(folder):
    grouped_csv(folder / "study.csv", known_observers("ABC"))
    options = ("--model", "symmetric", "--seed", "1", "--draws", "10", "--workers", "1")
    killed(folder, "population", "study.csv", "-o", "group.nc", "--resume", *options, kept=2)
    assert not (folder / "group.nc").exists()
    resumed = good("population", "study.csv", "-o", "group.nc", "--resume", *options, cwd=folder)
    assert "of 3 subjects taken from group.nc.partial" in resumed
    good("population", "study.csv", "-o", "calm.nc", *options, cwd=folder)
    assert not (folder / "group.nc.partial").exists()
    for ending in (".nc", ".csv", "_subjects.csv", ".png"):
        assert (folder / f"group{ending}").read_bytes() == (folder / f"calm{ending}").read_bytes()


def test_what_was_kept_is_thrown_away_where_that_is_asked_for(folder, three_models):
    grouped_csv(folder / "study.csv", known_observers("A"))
    (folder / "evidence.csv.partial").mkdir()
    (folder / "evidence.csv.partial" / "0.kept").write_text("of another time")
    options = ("evidence", "study.csv", "-o", "evidence.csv", "--seed", "1", "--workers", "1")
    assert "evidence.csv.partial: found 1 results of a stopped command" in refused(*options, cwd=folder)
    good(*options, "--overwrite", cwd=folder)
    assert sorted(path.name for path in folder.iterdir()) == ["evidence.csv", "study.csv"]
