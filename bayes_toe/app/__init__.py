"""A local web page for labs without code; nothing of the core imports this room."""
