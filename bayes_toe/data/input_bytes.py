"""Files as they come in: read at once, where they are files and of a size that can be read at once."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

#: Bytes of the largest file that is read: ten million trials, or a million of a wide file.
LARGEST = 2**30


def input_bytes(path: str | Path, largest: int = LARGEST) -> bytes:
    """The content of a file.

    Raises
    ------
    OSError
        If it cannot be read, is larger than `largest`, or is a pipe or a device, which may have no end.

    Examples
    --------
    >>> input_bytes("/dev/zero")
    Traceback (most recent call last):
        ...
    OSError: [Errno 22] a pipe or device, not a file
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EINVAL, "a pipe or device, not a file")
    if status.st_size > largest:
        raise OSError(errno.EFBIG, f"{status.st_size} bytes, more than {largest}")
    return Path(path).read_bytes()
