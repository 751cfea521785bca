"""What a study can show, and what speaks against its answers; known before any sampling."""
