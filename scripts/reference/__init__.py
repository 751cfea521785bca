"""Tempering and hard cases: what inference is checked against.

No module of the package uses them.
"""
