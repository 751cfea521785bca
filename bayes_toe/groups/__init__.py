"""The hierarchical posterior of a group of subjects.

It names no model.
"""
