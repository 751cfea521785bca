"""Posteriors to touch: one page that answers back, with Bokeh inside; the only room that imports it."""
