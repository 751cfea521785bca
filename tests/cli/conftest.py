"""An analysis in which something must be looked at, for results folders and reports."""

from dataclasses import replace

import pytest


@pytest.fixture(scope="session")
def marked(analysis):
    """The analysis of three subjects, of whom one is misfit, and one lacks an evidence."""
    first, second, third = analysis.evidence
    rows = (replace(first, fit=replace(first.fit, p_overall=0.001)), second, replace(third, log_evidence_symmetric=None))
    return replace(analysis, evidence=replace(analysis.evidence, rows=rows))
