"""An analysis in which something must be looked at, for results folders and reports."""

from dataclasses import replace

import pytest

from bayes_toe.comparison.reweighting import UnderPresets


@pytest.fixture(scope="session")
def marked(analysis):
    """The analysis of three subjects, of whom one is misfit and named differently by the presets, and one lacks an evidence."""
    first, second, third = analysis.evidence
    rows = (replace(first, fit=replace(first.fit, p_overall=0.001)), second, replace(third, log_evidence_symmetric=None))
    moved = UnderPresets("A", {"paper": (0.0, -9.0, -9.0), "stimuli": (-9.0, -9.0, 0.0)})
    return replace(
        analysis, evidence=replace(analysis.evidence, rows=rows), presets=(moved, UnderPresets("B", dict.fromkeys("ab", (0.0, 0.0, 0.0))))
    )
