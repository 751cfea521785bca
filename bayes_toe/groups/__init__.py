"""What a group of subjects has in common: the hierarchical posterior of a population.

It names no model.
"""
