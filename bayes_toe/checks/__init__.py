"""What a design can identify, and problems in the responses; known before any sampling."""
