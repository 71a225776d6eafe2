"""Cases that say the same of more files, seeds or arms than those that are always run."""

from functools import partial

import pytest

again = partial(pytest.param, marks=pytest.mark.long)
