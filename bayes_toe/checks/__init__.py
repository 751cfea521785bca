"""Checks before any sampling: what a design can identify, and problems in the responses."""
