"""Answers to the questions of a study."""
