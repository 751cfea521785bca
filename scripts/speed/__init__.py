"""The parts of scripts/speed_vs_error.py: subjects, methods, scores, tables, figures; one noun a file."""
