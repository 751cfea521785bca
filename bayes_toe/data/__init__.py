"""Studies and tables, in and out."""
