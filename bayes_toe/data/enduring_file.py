"""A file to write to that endures a full disk: for whom an error in the middle would be worse than one in the end."""

from __future__ import annotations

import io
from typing import Any


class EnduringFile(io.FileIO):
    """A file whose first failed write is kept in `failed` and not raised."""

    failed: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write; what comes after a failure is dropped."""
        if self.failed is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failed = error
        return memoryview(data).nbytes
