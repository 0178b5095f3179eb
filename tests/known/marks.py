"""Marks of tests that the suite runs with the newest numpy alone.

All that can differ with an older numpy is a line of core that calls it in a way it does not know.
Each line that a marked test runs is run by quicker tests as well, which are not marked: `dev.py
mutants` looks on, and names lines for which that is not so.
"""

import pytest

CASES = pytest.mark.newest_only(reason="thousands of cases: each line runs in quicker tests, too")
FITS = pytest.mark.newest_only(
    reason="many fits of one bench: each line runs in quicker tests, too"
)
ORDER = pytest.mark.newest_only(
    reason="orders of errors on many rigs: each line runs in quicker tests, too"
)
STATISTICS = pytest.mark.newest_only(
    reason="statistics of many samples: each line runs in quicker tests, too"
)
