"""Commands, reports and results folders."""
