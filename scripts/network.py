"""Exit code 0 where the network answers.

The site's own links are always followed, those that leave it only then.
"""

import sys
from urllib.error import HTTPError
from urllib.request import urlopen

try:
    urlopen("https://arxiv.org", timeout=5).close()
except HTTPError:
    pass  # an answer
except OSError:
    sys.exit(1)
