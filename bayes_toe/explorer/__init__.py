"""The explorer: a page of posteriors to select draws from. Only this room imports Bokeh."""
