"""Posteriors to touch: one page that answers back, with Bokeh inside.

It is the only room that imports it.
"""
