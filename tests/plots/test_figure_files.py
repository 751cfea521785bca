"""Figures as files."""

import pytest

from bayes_toe.errors import InputError, OutputError
from bayes_toe.plots.figure_files import require_figure


def test_a_figure_is_refused_before_it_is_drawn(tmp_path):
    (tmp_path / "old.png").write_text("precious")
    with pytest.raises(InputError, match="suffix 'xyz'"):
        require_figure(tmp_path / "new.xyz")
    with pytest.raises(OutputError, match="exists"):
        require_figure(tmp_path / "old.png")
    require_figure(tmp_path / "old.png", overwrite=True)
    require_figure(tmp_path / "new.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["old.png"]
