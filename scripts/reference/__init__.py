"""Deterministic integration and hard cases: what inference is checked against; no module of the package uses them."""
