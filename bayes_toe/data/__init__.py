"""Reading studies, and writing tables and files."""
